//! From a session to a model, and from the model to a law: `stillpoint identify` and `control.lqg`.

use std::path::Path;

use serde_json::Value;

use crate::{root, stillpoint, text};

/// What a command that went well printed as JSON.
fn said(folder: &Path, arguments: &[&str]) -> Value {
    let out = stillpoint(folder, arguments);
    assert!(out.status.success(), "{arguments:?}: {}{}", text(&out.stdout), text(&out.stderr));
    serde_json::from_slice(&out.stdout).unwrap()
}

/// Runs the loop, simulated; what the run said of it.
fn run(folder: &Path, seconds: &str, sets: &[&str]) -> Value {
    let file =
        root().join("tools/tests/command/identified.yaml").canonicalize().unwrap().display().to_string();
    let fixed = ["run", &file, "--clock", "simulated", "--record", "s", "--json", "--for", seconds];
    let sets: Vec<&str> = sets.iter().flat_map(|set| ["--set", set]).collect();
    said(folder, &[&fixed[..], &sets].concat())
}

#[test]
fn a_model_of_a_recorded_run_drives_the_law_of_the_next_and_its_session_keeps_it() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let excited = run(folder, "32 s", &[]);
    let session = excited["session"].as_str().unwrap();
    let model = folder.join("model.json");
    let model_file = model.display().to_string();
    let signals = ["--input", "law.duties:net.0", "--output", "filter.state:position.2"];
    let how = ["--order", "2", "--sample-time", "100 ms", "--model", &model_file, "--json"];
    let found = said(folder, &[&["identify", session][..], &signals, &how].concat());
    let fit = found["found"]["fit_percent"].as_f64().unwrap();
    assert!(fit > 80.0, "{fit} % one step ahead");

    let step = ["law.rise=4 s", "target.moves=[{ at: 1 s, z: 10 mm }]"];
    let set = format!("law.model={model_file}");
    let held = run(folder, "24 s", &[&[set.as_str()][..], &step].concat());
    let by_model = held["session"].as_str().unwrap();
    // The estimate against the target in the last five seconds.
    let height = &held["held"]["targets"][0]["channels"][0];
    assert_eq!((&height["channel"], &height["unit"]), (&"z".into(), &"mm".into()));
    assert!(height["worst"].as_f64().unwrap() < 1.0, "{height}");
    let report = said(folder, &["report", by_model, "--json"]);
    let controller = &report["sections"]["controllers"]["figures"]["controllers"][0];
    let way = &controller["channels"][0]["step"];
    let figure = |name: &str| way[name].as_f64().unwrap();
    assert!((2.0..6.0).contains(&figure("rise_s")) && figure("overshoot") < 2.0, "{way}");
    assert!(figure("left").abs() < 0.5 && figure("sd") < 0.5, "{way}");

    // The model is in the session: a replay needs no file, and another model makes other duties.
    std::fs::remove_file(&model).unwrap();
    let again = said(folder, &["replay", by_model, "--json"]);
    assert_eq!(again["identical_all"], true, "{again}");
    let without = run(folder, "24 s", &step);
    let duties = |session: &Value| {
        text(&stillpoint(folder, &["echo", "law.duties", "--session", session.as_str().unwrap()]).stdout)
    };
    assert_ne!(duties(&held["session"]), duties(&without["session"]));
}
