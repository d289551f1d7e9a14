//! A recorder that hangs: the run goes on without it, and ends.

use rustix::process::Signal;
use serde_json::{Value, json};

use crate::bench::{Bench, Running, lives, pipeline, signal, wait_for};

/// A run whose recorder hangs, and the recorder's number.
fn with_a_hung_recorder(bench: &Bench) -> (Running, u32) {
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 20);
    let part = bench.path("s/chain-0001/part-000.mcap");
    wait_for("a flush", || (part.metadata().ok()?.len() > 50_000).then_some(()));
    let recorder = run.child("recorder", 0);
    signal(recorder, Signal::STOP);
    (run, recorder)
}

/// Why the recording failed, of a run that says so and counts what is there nevertheless.
fn failure(report: &Value) -> &str {
    assert_eq!((&report["recorded"], &report["complete"]), (&json!([]), &json!(false)));
    assert!(report["samples"].as_u64().unwrap() > 20, "{}", report["samples"]);
    report["recording_failed"].as_str().unwrap()
}

/// How long it had not answered when it was killed, s, of a run that says so.
fn silence(report: &Value) -> f64 {
    let output_text = failure(report);
    let waited =
        output_text.split_once("it did not answer for ").and_then(|(_, rest)| rest.split_once(" s, and was"));
    waited.unwrap_or_else(|| panic!("{output_text}")).0.parse().unwrap()
}

/// In a second of `/proc`, on every Linux that this runs on.
const TICKS: f64 = 100.0;

/// When a process that lives began, s since the machine did.
fn began(number: u32) -> f64 {
    let stat = std::fs::read_to_string(format!("/proc/{number}/stat")).unwrap();
    let ticks = stat.rsplit_once(')').unwrap().1.split_whitespace().nth(19).unwrap();
    ticks.parse::<f64>().unwrap() / TICKS
}

/// Ends a run whose recorder was given up, and that goes on with these deaths of others. Gives the report.
fn ends_in_two_parts(bench: &Bench, run: Running, deaths: &[(&str, usize)]) -> Value {
    bench.wait_for_samples("sink.sum", 5);
    let report = run.stop().incomplete();
    let faults = report["faults"].as_array().unwrap();
    for (name, count) in deaths.iter().chain(&[("recorder", 1)]) {
        assert_eq!(faults.iter().filter(|f| f["operator"] == *name).count(), *count, "{name}: {faults:?}");
    }
    assert_eq!((&report["balanced"], &report["parts"]), (&json!(true), &json!(2)));
    report
}

#[test]
fn it_is_given_up_for_the_next_part_where_nobody_else_dies() {
    let bench = Bench::new();
    let (run, recorder) = with_a_hung_recorder(&bench);
    run.child("recorder", recorder);
    ends_in_two_parts(&bench, run, &[]);
}

#[test]
fn others_are_started_again_while_one_that_began_without_it_waits() {
    let bench = Bench::new();
    let (run, recorder) = with_a_hung_recorder(&bench);
    let mut middle = run.kill("middle", 0);
    // It was greeted: it does what it is there for.
    middle = run.child("middle", middle);
    wait_for("its activations", || {
        let entry: Value =
            serde_json::from_str(bench.wait_for_samples("middle.journal", 1).lines().next()?).ok()?;
        (entry["incarnation"] == 1).then_some(())
    });
    run.kill("middle", 0);
    let mut source = run.kill("source", 0);
    source = run.child("source", source);
    let source = began(source);
    let recorder = began(run.child("recorder", recorder));
    middle = run.child("middle", middle);
    assert!(source < recorder - 1.0, "the source began at {source}, the recorder at {recorder}");
    assert!(began(middle) > recorder - 1.0, "what it left waits for the recorder");
    ends_in_two_parts(&bench, run, &[("middle", 2), ("source", 1)]);
}

#[test]
fn a_worker_is_started_again_without_it_and_it_is_given_up_for_the_next_part() {
    let bench = Bench::new();
    let (run, recorder) = with_a_hung_recorder(&bench);
    let middle = run.kill("middle", 0);
    let middle = began(run.child("middle", middle));
    let recorder = began(run.child("recorder", recorder));
    assert!(middle < recorder - 1.0, "the worker began at {middle}, the recorder at {recorder}");
    let report = ends_in_two_parts(&bench, run, &[("middle", 1)]);

    assert_eq!(report["recording_failed"], json!(null));
    let retained = report["recorded"][0]["samples"].as_u64().unwrap();
    assert!(report["samples"].as_u64().unwrap() > retained, "the part that was cut counts, too");
}

#[test]
fn a_run_ends_without_it_and_says_so() {
    let bench = Bench::new();
    let (run, recorder) = with_a_hung_recorder(&bench);
    run.signal(Signal::TERM);
    let done = run.finish();
    assert_eq!(done.code(), 1, "{}", done.err);
    assert!(!lives(recorder));
    let report = done.json();
    assert!(silence(&report) >= 10.0);
    assert_eq!(report["ended_early"], "stopped");
}

#[test]
fn a_second_signal_ends_the_wait_for_it() {
    let bench = Bench::new();
    let (run, recorder) = with_a_hung_recorder(&bench);
    wait_for("the end", || {
        run.signal(Signal::TERM);
        (!lives(run.pid())).then_some(())
    });
    assert!(!lives(recorder));
    let report = run.finish().json();
    assert!(silence(&report) < 10.0);
}

#[test]
fn a_recorder_that_is_killed_at_the_end_is_named_and_another_ends_the_session() {
    let bench = Bench::new();
    let (run, recorder) = with_a_hung_recorder(&bench);
    run.signal(Signal::TERM);
    signal(recorder, Signal::KILL);
    let report = run.finish().good();
    let fault = report["faults"].as_array().unwrap().iter().find(|f| f["operator"] == "recorder").unwrap();
    assert!(fault["reason"].as_str().unwrap().contains("signal: 9"), "{fault}");
    assert_eq!((&report["recording_failed"], &report["parts"]), (&json!(null), &json!(2)));
}
