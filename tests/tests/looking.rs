//! What runs, its topics and their rates, and its end from outside, of live runs and of their sessions.

use serde_json::Value;

use crate::bench::{Bench, pipeline, text};

/// The row of a topic.
fn row<'v>(value: &'v Value, topic: &str) -> &'v Value {
    let rows = value["topics"].as_array().unwrap();
    rows.iter().find(|r| r["topic"] == topic).unwrap_or_else(|| panic!("{topic}: {value}"))
}

#[test]
fn runs_are_listed_with_pipeline_age_state_and_session() {
    let bench = Bench::new();
    assert_eq!(bench.call(&["ps", "--json"]).good()["runs"], serde_json::json!([]));
    assert!(bench.call(&["ps"]).out.contains("no pipeline is running"));
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 2);
    let found = bench.call(&["ps", "--json"]).good();
    let listed = &found["runs"][0];
    assert_eq!((&listed["pipeline"], &listed["state"]), (&"chain".into(), &"running".into()), "{found}");
    assert_eq!(listed["run"], run.pid());
    assert!(listed["age_s"].as_f64().unwrap() > 0.0, "{found}");
    assert!(listed["session"].as_str().unwrap().ends_with("chain-0001"), "{found}");
    let shown = bench.call(&["ps"]).out;
    assert!(shown.contains("chain") && shown.contains("running"), "{shown}");
    // The supervisor alone is stopped.
    crate::bench::signal(run.pid(), rustix::process::Signal::STOP);
    let suspended = bench.call(&["ps", "--json"]).good();
    crate::bench::signal(run.pid(), rustix::process::Signal::CONT);
    assert_eq!(suspended["runs"][0]["state"], "suspended", "{suspended}");
    run.stop().good();
}

#[test]
fn topics_and_rates_of_a_run_and_of_its_session_have_one_shape() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 2);
    let topics = bench.call(&["topics", "--json"]).good();
    let value = row(&topics, "source.value");
    assert_eq!(value["consumers"], serde_json::json!(["middle", "sink"]), "{topics}");
    assert_eq!(topics["of"]["run"], run.pid());
    assert!(value["rate_hz"].as_f64().unwrap() > 0.0 && value["bytes"].as_u64().unwrap() > 32, "{topics}");
    let rates = bench.call(&["hz", "source.value", "--for", "500 ms", "--json"]).good();
    assert_eq!(rates["topics"].as_array().unwrap().len(), 1, "{rates}");
    let measured = row(&rates, "source.value");
    assert!(measured["samples"].as_u64().unwrap() > 2, "{rates}");
    assert!(measured["interval_ms"]["jitter"].as_f64().unwrap() >= 0.0, "{rates}");
    let unknown = bench.call(&["hz", "source.valeu"]);
    assert!(unknown.code() == 2 && unknown.err.contains("did you mean source.value?"), "{}", unknown.err);
    let report = run.stop().good();
    let session = report["session"].as_str().unwrap();
    let recorded = bench.call(&["topics", "--session", session, "--json"]).good();
    let repeated = row(&recorded, "source.value");
    let keys = |v: &Value| v.as_object().unwrap().keys().cloned().collect::<Vec<_>>();
    assert_eq!(keys(repeated), keys(value));
    assert_eq!((&repeated["consumers"], &repeated["type"]), (&value["consumers"], &value["type"]));
    let sent = crate::bench::figures(&report, "source")["sent"].as_u64().unwrap();
    let rates = bench.call(&["hz", "--session", session, "--json"]).good();
    assert_eq!(row(&rates, "source.value")["samples"], sent);
    bench.call(&["replay", session, "--json"]).good();
}

#[test]
fn a_run_that_is_stopped_from_outside_ends_in_order() {
    let bench = Bench::new();
    let nobody = bench.call(&["stop"]);
    assert!(nobody.code() == 1 && nobody.err.contains("no pipeline is running"), "{}", nobody.err);
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 2);
    let stopped = bench.call(&["stop", "--run", "chain", "--json"]).good();
    assert_eq!(stopped["run"], run.pid(), "{stopped}");
    // The run ended as by Ctrl-C: its session is whole.
    let report = run.finish().good();
    assert_eq!(report["ended_early"], "stopped", "{report}");
    assert_eq!(stopped["session"].as_str().map(|s| s.ends_with("chain-0001")), Some(true), "{stopped}");
    bench.call(&["replay", report["session"].as_str().unwrap(), "--json"]).good();
}

#[test]
fn samples_are_shown_in_words_by_path_and_as_json() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("console.yaml"));
    bench.wait_for_samples("after.sum", 2);
    assert_eq!(bench.call(&["send", "console.arm"]).code(), 0);
    let report = run.stop().good();
    let session = report["session"].as_str().unwrap();
    let screen = bench.call(&["echo", "console.arm", "--session", session]);
    assert!(screen.out.lines().any(|l| l.split_whitespace().eq(["verb", "arm"])), "{}", screen.out);
    let path = bench.call(&["echo", "console.arm", "verb", "values[1]", "--session", session]);
    assert_eq!(path.out, "verb: arm   values[1]: 0\n");
    let json = bench.call(&["echo", "console.arm", "verb", "--json", "--session", session]);
    let value: Value = serde_json::from_str(&json.out).unwrap();
    assert_eq!((&value["verb"], &value["words"]["verb"]), (&1.into(), &serde_json::json!(["arm"])));
    let wrong = bench.call(&["echo", "console.arm", "values[9]", "--session", session]);
    assert!(wrong.code() == 2 && wrong.err.contains("(allowed: 0 to 5)"), "{}", wrong.err);
    let journal = bench.call(&["echo", "console.journal", "cause", "--count", "1", "--session", session]);
    assert_eq!(journal.out, "cause: start\n");
    assert!(text(std::path::Path::new(session)).contains("console-0001"));
}

#[test]
fn the_commands_of_the_guide_do_what_it_says() {
    const PAGE: &str = include_str!("../../docs/guide/look-inside.md");
    let bench = Bench::new();
    let file = crate::bench::small_loop(&bench, include_str!("../../pipeline.yaml"), "examples/data/rig.key");
    let run = bench.run(&file);
    bench.wait_for_samples("filter.state", 1);
    let blocks = PAGE.split("```sh\n").skip(1).map(|rest| rest.split("```").next().unwrap());
    let commands: Vec<&str> = blocks.flat_map(str::lines).collect();
    assert!(commands.len() >= 10, "{commands:?}");
    for command in commands {
        let words: Vec<&str> = command.split_whitespace().skip(1).collect();
        let done = bench.call(&words);
        assert!(done.code() == 0 && !done.out.is_empty(), "{command}: {}{}", done.out, done.err);
        match words.as_slice() {
            ["echo", "gate.state", "beam", ..] => assert!(done.out.starts_with("beam: o"), "{}", done.out),
            ["echo", "filter.state", ..] => assert!(done.out.contains(" deg "), "{}", done.out),
            ["types", "Gate"] => assert!(done.out.contains("| pose stale |"), "{}", done.out),
            _ => {}
        }
    }
    assert_eq!(run.finish().good()["ended_early"], "stopped");
}
