//! Faults that are planted in loops from camera to valve, and what names each from the outside.

use std::os::unix::fs::PermissionsExt;

use serde_json::Value;

use crate::bench::{Bench, Running, pipeline, text};

const DEFAULT: &str = include_str!("../../pipeline.yaml");
const KEY: &str = "examples/data/rig.key";

/// Waits until `top` names a trouble with all these words.
fn wait_for_trouble(bench: &Bench, words: &[&str]) {
    crate::bench::wait_for(&words.join(" "), || {
        let top = bench.call(&["top", "--once", "--for", "500 ms", "--json"]).good();
        let troubles: Vec<String> = serde_json::from_value(top["troubles"].clone()).unwrap();
        troubles.iter().any(|t| words.iter().all(|word| t.contains(word))).then_some(())
    });
}

/// A running loop that has an estimate of the head.
fn loop_of(bench: &Bench, yaml: &str) -> Running {
    let file = crate::bench::small_loop(bench, yaml, KEY);
    let run = bench.run(&file);
    bench.wait_for_samples("valves.state", 2);
    run
}

#[test]
fn a_dead_far_end_is_named_by_the_valves() {
    let bench = Bench::new();
    let run = loop_of(&bench, DEFAULT);
    crate::bench::signal(run.child("bedside", 0), rustix::process::Signal::STOP);
    wait_for_trouble(&bench, &["far: suspended"]);
    wait_for_trouble(&bench, &["valves.state: the far end acknowledges no order"]);
    crate::bench::signal(run.child("bedside", 0), rustix::process::Signal::CONT);
    run.stop();
}

#[test]
fn orders_that_the_far_end_refuses_are_named_with_their_reason() {
    let bench = Bench::new();
    let other = "params: { key: other.key, acknowledge_every: 20 ms }";
    let yaml = DEFAULT.replace("params: { key: examples/data/rig.key, acknowledge_every: 20 ms }", other);
    assert_ne!(yaml, DEFAULT);
    let key = bench.path("other.key");
    std::fs::write(&key, "0123456789abcdef".repeat(4)).unwrap();
    std::fs::set_permissions(&key, std::fs::Permissions::from_mode(0o600)).unwrap();
    let run = loop_of(&bench, &yaml);
    wait_for_trouble(&bench, &["far.state: ", "orders refused: forged"]);
    let report = run.stop();
    assert!(report.json()["held"].to_string().contains("forged"), "{}", report.out);
}

#[test]
fn a_clock_that_is_set_while_a_pipeline_runs_is_named() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 2);
    let top = bench.call(&["top", "--once", "--for", "100 ms", "--json"]).good();
    assert!(top["clock_set_s"].as_f64().unwrap().abs() < 0.5, "{top}");
    // The clock of this machine stays as it is; the card of the run says that it was 3 s behind at the start.
    let card = bench.runs().join(&bench.run_ids()[0]).join("run.json");
    let mut value: Value = serde_json::from_slice(&std::fs::read(&card).unwrap()).unwrap();
    let started = value["clock"]["realtime_start"].as_u64().unwrap();
    value["clock"]["realtime_start"] = (started - 3_000_000_000).into();
    std::fs::write(&card, value.to_string()).unwrap();
    wait_for_trouble(&bench, &["the clock of this machine was set by +3.0 s since the run began"]);
    run.stop().good();
}

#[test]
fn a_wrong_unit_is_named_by_doctor_or_at_the_end_of_the_run() {
    let bench = Bench::new();
    // A unit of another quantity is refused before anything runs.
    let file = bench.path("gain.yaml");
    let yaml = std::fs::read_to_string(pipeline("settings.yaml")).unwrap();
    std::fs::write(&file, yaml.replace("rise: 5 s", "rise: 5 s, proportional: 3 mm/s")).unwrap();
    let refused = bench.call(&["doctor", text(&file)]);
    assert!(
        refused.code() == 2 && refused.err.contains("mm/s") && refused.err.contains("1/s"),
        "{}",
        refused.err
    );
    // A length in cm that should be in mm is a place: the camera is there, and sees no face.
    let file = bench.path("far.yaml");
    let yaml = std::fs::read_to_string(pipeline("seeing.yaml")).unwrap();
    std::fs::write(&file, yaml.replace("-480 mm", "-480 cm")).unwrap();
    let done =
        bench.call(&["run", text(&file), "--clock", "simulated", "--for", "2 s", "--strict", "--no-record"]);
    let all = format!("{}{}", done.out, done.err);
    assert!(done.code() == 1 && all.contains("NO ANSWER: face: 0 of "), "{} {all}", done.code());
}

#[test]
fn a_process_without_a_core_is_named() {
    let bench = Bench::new();
    let yaml = std::fs::read_to_string(pipeline("planted.yaml")).unwrap();
    let file = bench.path("starved.yaml");
    std::fs::write(
        &file,
        yaml.replace("processes:\n", "processes:\n  slow: { operators: [slow], core: 0 }\n"),
    )
    .unwrap();
    // Another who never rests on the same core.
    let spin = ["-c", "0", "sh", "-c", "while :; do :; done"];
    let mut other = std::process::Command::new("taskset").args(spin).spawn().unwrap();
    let run = bench.run(&file);
    bench.wait_for_samples("slow.sum", 1);
    wait_for_trouble(&bench, &["process slow: waited for a core in"]);
    other.kill().unwrap();
    other.wait().unwrap();
    run.stop();
}

#[test]
fn a_full_disk_is_named_while_the_run_goes_on_and_by_doctor() {
    let bench = Bench::new();
    let Some(_disk) = crate::bench::small_disk(&bench, "4m") else { return };
    let file = pipeline("flood.yaml");
    // Before the run, the doctor names the disk; the same disk is not named where sessions go elsewhere.
    let disk_of = |record: &str| {
        let done = bench.call(&["doctor", text(&file), "--for", "100 ms", "--record", record, "--json"]);
        let findings = done.json()["findings"].as_array().unwrap().clone();
        findings.into_iter().find(|f| f["setting"] == "disk of sessions").unwrap()
    };
    assert_eq!(disk_of("disk/sessions")["verdict"], "bad", "{}", disk_of("disk/sessions"));
    assert!(disk_of("elsewhere")["found"].as_str().unwrap().contains("elsewhere"));
    let run = bench.start(&["run", text(&file), "--json", "--record", "disk"]);
    crate::bench::wait_for("the run", || (bench.call(&["topics"]).code() == 0).then_some(()));
    crate::bench::wait_for("the answer of the disk", || {
        run.has_answered("No space left on device").then_some(())
    });
    wait_for_trouble(&bench, &["the disk of the session is full", "make room on it"]);
    let done = run.stop();
    assert_eq!(done.code(), 1, "a recording was asked for, and there is none");
    assert_eq!(done.json()["complete"], false, "{}", done.out);
}
