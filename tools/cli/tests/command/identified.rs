//! From a session to a model, and from the model to a law: `stillpoint identify` and `control.lqg`.

use std::path::Path;

use serde_json::Value;

use crate::{root, stillpoint, text};

/// What a command that went well printed as JSON.
fn output_text(folder: &Path, arguments: &[&str]) -> Value {
    let out = stillpoint(folder, arguments);
    assert!(out.status.success(), "{arguments:?}: {}{}", text(&out.stdout), text(&out.stderr));
    serde_json::from_slice(&out.stdout).unwrap()
}

/// Runs the loop, simulated; what the run said of it.
fn run(folder: &Path, seconds: &str, sets: &[&str]) -> Value {
    let file =
        root().join("tools/cli/tests/command/identified.yaml").canonicalize().unwrap().display().to_string();
    let fixed = ["run", &file, "--clock", "simulated", "--record", "s", "--json", "--for", seconds];
    let sets: Vec<&str> = sets.iter().flat_map(|set| ["--set", set]).collect();
    output_text(folder, &[&fixed[..], &sets].concat())
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
    let found = output_text(folder, &[&["identify", session][..], &signals, &how].concat());
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
    let report = output_text(folder, &["report", by_model, "--json"]);
    let controller = &report["sections"]["controllers"]["figures"]["controllers"][0];
    let route = &controller["channels"][0]["step"];
    let figure = |name: &str| route[name].as_f64().unwrap();
    assert!((2.0..6.0).contains(&figure("rise_s")) && figure("overshoot") < 2.0, "{route}");
    assert!(figure("left").abs() < 0.5 && figure("sd") < 0.5, "{route}");

    // The model is in the session: a replay needs no file, and another model makes other duties.
    std::fs::remove_file(&model).unwrap();
    let repeated = output_text(folder, &["replay", by_model, "--json"]);
    assert_eq!(repeated["identical_all"], true, "{repeated}");
    let without = run(folder, "24 s", &step);
    let duties = |session: &Value| {
        text(
            &stillpoint(folder, &["echo", "--json", "law.duties", "--session", session.as_str().unwrap()])
                .stdout,
        )
    };
    assert_ne!(duties(&held["session"]), duties(&without["session"]));
}

/// A table of `samples` rows in which y(k+1) = pole y(k) + effect u(k), and a little noise comes with each.
fn table(file: &Path, pole: f64, effect: f64, samples: u32) {
    let (mut y, mut rows) = (0.0, "u,y\n".to_string());
    for k in 0..samples {
        let u = if (k / 23) % 2 == 0 { 1.0 } else { -1.0 };
        let e = 0.01 * (f64::from(k * 7919 % 101) / 50.0 - 1.0);
        rows.push_str(&format!("{u},{y}\n"));
        y = pole * y + effect * u + e;
    }
    std::fs::write(file, rows).unwrap();
}

const FIT: [&str; 13] = [
    "identify",
    "t.csv",
    "--input",
    "u",
    "--output",
    "y",
    "--order",
    "1",
    "--sample-time",
    "100 ms",
    "--offset",
    "none",
    "--model",
];

#[test]
fn an_unstable_model_is_said_to_be_so_and_not_written() {
    let folder = tempfile::tempdir().unwrap();
    table(&folder.path().join("t.csv"), 1.05, 0.3, 200);
    let out = stillpoint(folder.path(), &[&FIT[..], &["m.json"]].concat());
    let (output_text, why) = (text(&out.stdout), text(&out.stderr));
    assert_eq!(out.status.code(), Some(1), "{output_text}{why}");
    assert!(output_text.contains("no DC gain") && !output_text.contains("\nDC gain"), "{output_text}");
    assert!(
        why.contains("the model is unstable: the pole 1.05") && why.contains("m.json is not written"),
        "{why}"
    );
    assert!(why.contains("try another --order"), "{why}");
    assert!(!folder.path().join("m.json").exists());

    let out = stillpoint(folder.path(), &[&FIT[..12], &["--json"]].concat());
    assert_eq!(out.status.code(), Some(1));
    let output_text: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert!(output_text["found"]["dc_gain"].is_null() && output_text["model"].is_null(), "{output_text}");
    assert!(output_text["found"]["poles"][0]["modulus"]["value"].as_f64().unwrap() > 1.04, "{output_text}");
}

#[test]
fn doubtful_models_are_written_with_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let text_of = |pole: f64, effect: f64| {
        table(&folder.path().join("t.csv"), pole, effect, 400);
        let out = stillpoint(folder.path(), &[&FIT[..], &["m.json"]].concat());
        assert!(out.status.success(), "{}{}", text(&out.stdout), text(&out.stderr));
        std::fs::remove_file(folder.path().join("m.json")).unwrap();
        text(&out.stdout).to_owned()
    };
    let sound = text_of(0.9, 0.3);
    assert!(!sound.contains("warning"), "{sound}");
    let integrating = text_of(1.0, 0.3);
    assert!(integrating.contains("warning: the pole 1.00") || integrating.contains("warning: the pole 0.99"));
    assert!(integrating.contains("cannot be distinguished from one on the unit circle"), "{integrating}");
    let unexplained = text_of(0.995, 0.0);
    assert!(unexplained.contains("the input explains nothing"), "{unexplained}");
}
