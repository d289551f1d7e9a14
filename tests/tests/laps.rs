//! Laps: a live run measures stages, everyone can look, and nothing depends on it.

use serde_json::Value;

use crate::bench::{Bench, figures, pipeline, text};

fn metric(sample: &Value, name: &str) -> f64 {
    let all = sample["elements"].as_array().unwrap();
    all.iter().find(|m| m["name"] == name).unwrap()["value"].as_f64().unwrap()
}

fn topics(bench: &Bench, session: &str) -> Vec<(String, u64)> {
    let info = bench.call(&["info", session, "--json"]).good();
    assert_eq!(info["complete"], true, "{}", info["gaps"]);
    let all = info["topics"].as_array().unwrap();
    all.iter().map(|t| (t["name"].as_str().unwrap().to_owned(), t["samples"].as_u64().unwrap())).collect()
}

#[test]
fn every_live_activation_says_how_long_its_stages_took_and_replay_leaves_that_out() {
    let bench = Bench::new();
    let report =
        bench.call(&["run", text(&pipeline("laps.yaml")), "--for", "1 s", "--json", "--record", "s"]).good();
    assert_eq!(report["balanced"], true, "{}", report["ledger"]);
    let session = report["session"].as_str().unwrap();
    let retained = topics(&bench, session);
    for operator in ["alone", "first"] {
        let done = figures(&report, operator)["activations"].as_u64().unwrap();
        assert!(done > 20);
        assert!(retained.contains(&(format!("{operator}.timing"), done)), "{retained:?}");
    }
    let echo = bench.call(&["echo", "--json", "alone.timing", "--session", session]);
    for (index, line) in echo.out.lines().enumerate() {
        let sample: Value = serde_json::from_str(line).unwrap();
        assert_eq!(sample["sequence"], index);
        // Two turns of 300 us at least: a stage that is entered twice sums.
        assert!(metric(&sample, "long_s") >= 600e-6, "{sample}");
        assert!(metric(&sample, "short_s") > 0.0);
        assert_eq!(metric(&sample, "never_s"), 0.0);
    }
    let replay = bench.call(&["replay", session, "--json"]).good();
    assert_eq!(replay["identical_all"], true);
    let measured: Vec<_> = replay["measured"].as_object().unwrap().keys().collect();
    assert_eq!(measured, ["alone.timing", "first.timing"]);
    assert!(replay["identical"].get("alone.timing").is_none());
    let output_text = bench.call(&["replay", session]).out;
    assert!(output_text.contains("measured when it was recorded, not compared"), "{output_text}");
}

#[test]
fn a_lap_that_is_not_named_fails_the_activation_wherever_it_runs() {
    let file = pipeline("laps.yaml");
    let fault = |bench: &Bench, placement: &[&str]| {
        let arguments =
            [&["run", text(&file), "--for", "500 ms", "--json", "--record", "s"], placement].concat();
        let report = bench.call(&arguments).good();
        assert_eq!(figures(&report, "first")["errors"], 1, "{placement:?}");
        report["session"].as_str().unwrap().to_owned()
    };
    let live = Bench::new();
    fault(&live, &[]);
    let simulated = Bench::new();
    let session = fault(&simulated, &["--clock", "simulated"]);
    let retained = topics(&simulated, &session);
    assert!(
        !retained.iter().any(|(name, _)| name.ends_with(".timing")),
        "a simulation measures nothing: {retained:?}"
    );
}

#[test]
fn laps_of_a_running_pipeline_are_shown() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("laps.yaml"));
    let out = bench.wait_for_samples("first.timing", 3);
    assert_eq!(out.lines().count(), 3);
    // Where a step is to blame, its laps say in which part of it.
    let trace = bench.call(&["trace", "laps", "--to", "last", "--for", "1 s", "--json"]).good();
    check_laps(&trace);
    let unknown = bench.call(&["echo", "first.timinf", "--count", "1"]);
    assert!(unknown.err.contains("did you mean first.timing?"), "{}", unknown.err);
    let report = run.stop().good();
    let session = report["session"].as_str().unwrap();
    check_laps(&bench.call(&["trace", session, "--to", "last", "--json"]).good());
    let text = bench.call(&["trace", session, "--to", "last"]).out;
    assert!(text.contains("alone     short") && text.contains("first     long"), "{text}");
}

/// The laps of the operator `alone` on its path.
fn check_laps(trace: &Value) {
    let path = trace["paths"].as_array().unwrap().iter().find(|p| p["arrived"].as_u64() > Some(3)).unwrap();
    let hop = path["hops"].as_array().unwrap().iter().find(|h| h["operator"] == "alone").unwrap();
    let laps = hop["laps"].as_array().unwrap();
    assert_eq!(
        laps.iter().map(|l| l["lap"].as_str().unwrap()).collect::<Vec<_>>(),
        ["short", "long", "never"]
    );
    let time = |lap: usize, quantile: &str| laps[lap]["time_ms"][quantile].as_f64().unwrap();
    assert!(time(1, "p50") >= 0.6 && time(0, "p50") > 0.0 && time(2, "max") == 0.0, "{hop}");
    assert!(time(0, "p50") + time(1, "p50") <= hop["step_ms"]["max"].as_f64().unwrap(), "{hop}");
    // A step to blame has the lap; another part has none.
    for worst in path["worst"].as_array().unwrap() {
        assert!(worst["part"] == "step" || worst["lap"].is_null(), "{worst}");
    }
}
