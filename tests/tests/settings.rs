//! Parameters that people change while a pipeline runs.

use serde_json::Value;

use crate::bench::{Bench, pipeline, text};

/// The row of a parameter in a list of rows.
fn row<'v>(rows: &'v Value, parameter: &str) -> &'v Value {
    let all = rows.as_array().unwrap();
    all.iter().find(|r| r["parameter"] == parameter).unwrap_or_else(|| panic!("{parameter}: {rows}"))
}

#[test]
fn a_parameter_that_is_set_while_it_runs_is_answered_shown_recorded_and_replayed() {
    let bench = Bench::new();
    let file = pipeline("settings.yaml");
    let run = bench.start(&["run", text(&file), "--set", "law.integral=0.2", "--json", "--record", "s"]);
    bench.wait_for_samples("law.duties", 2);
    let listed = bench.call(&["set", "--json"]).json();
    assert_eq!(row(&listed, "law.proportional")["from"], "default", "{listed}");
    assert_eq!(row(&listed, "law.integral")["from"], "--set", "{listed}");
    assert_eq!(row(&listed, "law.rise")["from"], "file", "{listed}");

    let taken = bench.call(&["set", "law.proportional", "3 1/s", "--json"]);
    assert_eq!(taken.code(), 0, "{}{}", taken.out, taken.err);
    let taken = taken.json();
    assert_eq!((&taken["taken"], &taken["generation"]), (&true.into(), &1.into()), "{taken}");
    let again = bench.call(&["set", "law.integral", "0.3"]);
    assert!(
        again.code() == 0 && again.out.contains("in generation 2 from activation"),
        "{}{}",
        again.out,
        again.err
    );
    let refused = bench.call(&["set", "rig.camera.every", "30 ms"]);
    assert!(refused.code() == 1 && refused.out.contains("multiple"), "{}{}", refused.out, refused.err);
    for (arguments, words) in [
        (["law.proportional", "3"], "unit"),
        (["law.proportional", "300 1/s"], "from 0 1/s to 100 1/s"),
        (["law.propotional", "3 1/s"], "did you mean `proportional`?"),
        (["law.stale", "100 ms"], "is not live"),
        (["lwa.proportional", "3 1/s"], "did you mean `law`?"),
    ] {
        let wrong = bench.call(&["set", arguments[0], arguments[1]]);
        assert!(wrong.code() == 2 && wrong.err.contains(words), "{arguments:?}: {}", wrong.err);
    }
    // Who joins now sees what was changed before.
    let listed = bench.call(&["set", "law", "--json"]).json();
    let gain = row(&listed, "law.proportional");
    assert_eq!((&gain["value"], &gain["from"]), (&3.0.into(), &"live".into()), "{listed}");
    let top = bench.call(&["top", "--once", "--json", "--for", "200 ms"]).good();
    assert_eq!(row(&top["changed"], "law.integral")["value"], 0.3, "{top}");

    let report = run.stop().good();
    let session = report["session"].as_str().unwrap();
    let replay = bench.call(&["replay", session, "--json"]).good();
    assert_eq!(replay["identical_all"], true, "{replay}");
    assert_eq!(replay["identical"]["law.settings"], 2, "{replay}");
    let top = bench.call(&["top", session, "--once", "--json"]).good();
    assert_eq!(row(&top["changed"], "law.proportional")["value"], 3.0, "{top}");
    let echo = bench.call(&["echo", "console.set", "--json", "--session", session]);
    assert_eq!(echo.out.lines().count(), 3, "{}", echo.out);
}

#[test]
fn a_simulated_session_with_a_changed_parameter_replays_from_this_process_and_from_processes() {
    let bench = Bench::new();
    let file = pipeline("settings.yaml");
    let script = "console.script=[{ at: 300 ms, say: set, parameter: law.proportional, value: 3 1/s }]";
    let run = ["run", text(&file), "--set", script, "--for", "1 s", "--json"];
    let local = bench.call(&[&run[..], &["--clock", "simulated"]].concat()).good();
    let processes = bench.call(&[&run[..], &["--lock-step", "processes"]].concat()).good();
    for report in [&local, &processes] {
        let session = report["session"].as_str().unwrap();
        let replay = bench.call(&["replay", session, "--json"]).good();
        assert_eq!(replay["identical"]["law.settings"], 1, "{replay}");
        assert_eq!(replay["identical_all"], true, "{replay}");
    }
}
