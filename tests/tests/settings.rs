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

/// The samples of a topic in a session.
fn samples(bench: &Bench, topic: &str, session: &str) -> Vec<Value> {
    let done = bench.call(&["echo", "--json", topic, "--session", session]);
    assert_eq!(done.code(), 0, "{}", done.err);
    done.out.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

#[test]
fn changed_parameters_hold_over_a_restart_on_request_and_over_the_death_of_the_process() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("settings.yaml"));
    bench.wait_for_samples("law.duties", 2);
    assert_eq!(bench.call(&["set", "law.proportional", "3 1/s"]).code(), 0);
    // On request: the next incarnation is named with its first activation.
    let receipt = bench.call(&["restart", "law", "--json"]).good();
    assert_eq!((&receipt["operator"], &receipt["incarnation"]), (&"law".into(), &1.into()), "{receipt}");
    let [began, first] = ["began_ns", "first_activation_ns"].map(|key| receipt[key].as_u64().unwrap());
    assert!(first > began, "{receipt}");
    let gain = |bench: &Bench| {
        let listed = bench.call(&["set", "law", "--json"]).json();
        let row = row(&listed, "law.proportional").clone();
        (row["value"].clone(), row["from"].clone())
    };
    assert_eq!(gain(&bench), (3.0.into(), "live".into()));
    // A second change, and a death of the process.
    let second = bench.call(&["set", "law.integral", "0.3", "--json"]).good();
    assert_eq!(second["generation"], 2, "{second}");
    run.kill("law", 0);
    crate::bench::wait_for("the next incarnation", || {
        let samples = bench.call(&["echo", "--json", "law.duties", "--count", "1"]);
        let sample: Value = serde_json::from_str(samples.out.lines().next()?).ok()?;
        (sample["incarnation"].as_u64()? == 2).then_some(())
    });
    assert_eq!(gain(&bench), (3.0.into(), "live".into()));
    let text = bench.call(&["restart", "law"]);
    assert!(
        text.code() == 0 && text.out.contains("law was restarted: incarnation 3, first activated"),
        "{}",
        text.out
    );
    let unknown = bench.call(&["restart", "lwa"]);
    assert!(unknown.code() == 2 && unknown.err.contains("did you mean `law`?"), "{}", unknown.err);
    let log = bench.call(&["log", "--operator", "law"]).out;
    assert!(log.matches("restarts on request of").count() == 2, "{log}");
    let report = run.stop().good();
    assert_eq!(report["balanced"], true, "{report}");
    let session = report["session"].as_str().unwrap();
    let replay = bench.call(&["replay", session, "--json"]).good();
    assert_eq!(replay["identical_all"], true, "{replay}");
    let top = bench.call(&["top", session, "--once", "--json"]).good();
    assert_eq!(row(&top["changed"], "law.proportional")["value"], 3.0, "{top}");
    assert_eq!(row(&top["changed"], "law.integral")["value"], 0.3, "{top}");
}

#[test]
fn a_gate_that_is_restarted_has_its_narrowed_limits_and_the_beam_stays_off_until_it_has_judged() {
    let bench = Bench::new();
    let file = crate::bench::small_loop(&bench, include_str!("../../pipeline.yaml"), "examples/data/rig.key");
    let run = bench.run(&file);
    bench.wait_for_samples("gate.state", 2);
    let narrowed = bench.call(&["set", "gate.position_tolerance", "0.2 mm", "--json"]).good();
    assert_eq!(narrowed["taken"], true, "{narrowed}");
    let receipt = bench.call(&["restart", "gate", "--json"]).good();
    assert_eq!(receipt["incarnation"], 1, "{receipt}");
    let listed = bench.call(&["set", "gate", "--json"]).json();
    let tolerance = row(&listed, "gate.position_tolerance");
    assert_eq!((&tolerance["value"], &tolerance["from"]), (&2e-4.into(), &"live".into()), "{listed}");
    // The process of the gate dies, with the operators next to it.
    run.kill("control", 0);
    crate::bench::wait_for("the gate", || {
        let states = bench.call(&["echo", "--json", "gate.state", "--count", "1"]);
        let state: Value = serde_json::from_str(states.out.lines().next()?).ok()?;
        (state["incarnation"].as_u64()? == 2).then_some(())
    });
    let listed = bench.call(&["set", "gate", "--json"]).json();
    assert_eq!(row(&listed, "gate.position_tolerance")["value"], 2e-4, "{listed}");
    let report = run.stop().json();
    let session = report["session"].as_str().unwrap();
    let states = samples(&bench, "gate.state", session);
    // No incarnation begins with the beam on, and in each a lease needs the narrow limit.
    for incarnation in 0..3 {
        let own = states.iter().filter(|s| s["incarnation"] == incarnation);
        let first =
            own.clone().next().unwrap_or_else(|| panic!("incarnation {incarnation}: {}", states.len()));
        assert_eq!(first["elements"][0]["beam"], 0, "{first}");
        if incarnation > 0 {
            for state in own.filter(|s| s["elements"][0]["beam"] == 1) {
                let error = state["elements"][0]["position_error"][2].as_f64().unwrap();
                assert!(error.abs() <= 2e-4, "{state}");
            }
        }
    }
    let replay = bench.call(&["replay", session, "--json"]).good();
    assert_eq!(replay["identical_all"], true, "{replay}");
}
