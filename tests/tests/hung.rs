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

#[test]
fn a_worker_is_started_again_without_it_and_it_is_given_up_for_the_next_part() {
    let bench = Bench::new();
    let (run, recorder) = with_a_hung_recorder(&bench);
    let middle = run.kill("middle", 0);
    run.child("middle", middle);
    assert_eq!(run.child("recorder", 0), recorder, "it is waited for longer than the worker");
    run.child("recorder", recorder);
    bench.wait_for_samples("sink.sum", 5);
    let report = run.stop().good();

    let faults = report["faults"].as_array().unwrap();
    let died = |name: &str| faults.iter().filter(|f| f["operator"] == name).count();
    assert_eq!((died("middle"), died("recorder")), (1, 1), "{faults:?}");
    assert_eq!((&report["balanced"], &report["parts"]), (&json!(true), &json!(2)));
    assert_eq!(report["recording_failed"], json!(null));
    let kept = report["recorded"][0]["samples"].as_u64().unwrap();
    assert!(report["samples"].as_u64().unwrap() > kept, "the part that was cut counts, too");
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
    assert!(failure(&report).contains("it did not answer for 10."), "{}", failure(&report));
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
    let waited = failure(&report).split_once("answer for ").unwrap().1.split_once(" s").unwrap().0;
    assert!(waited.parse::<f64>().unwrap() < 10.0, "{waited} s");
}

#[test]
fn a_recorder_that_is_killed_at_the_end_is_named() {
    let bench = Bench::new();
    let (run, recorder) = with_a_hung_recorder(&bench);
    run.signal(Signal::TERM);
    signal(recorder, Signal::KILL);
    let done = run.finish();
    assert_eq!(done.code(), 1, "{}", done.err);
    let report = done.json();
    assert!(failure(&report).contains("signal: 9"), "{}", failure(&report));
}
