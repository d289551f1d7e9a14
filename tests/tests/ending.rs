//! How runs end: by signals, in order; and what is left when the supervisor itself is killed.

use rustix::process::Signal;
use serde_json::json;

use crate::bench::{Bench, Running, line, lives, pipeline, shared_objects, text, wait_for};

/// A signal to the whole group ends a run in order.
fn ends_in_order(signal: Signal) {
    let bench = Bench::new();
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 10);
    let id = bench.run_ids().pop().unwrap();
    let children = run.children();
    assert_eq!(children.len(), 4, "{children:?}");

    run.signal_group(signal);
    let report = run.finish().good();

    assert_eq!(report["ended_early"], "stopped");
    assert_eq!(report["balanced"], true);
    // Queues drained: what was sent was taken.
    for consumer in ["middle.queue", "sink.queue"] {
        assert_eq!(line(&report, consumer)["left"], 0, "{}", report["ledger"]);
    }
    assert_eq!(report["faults"], json!([]));
    assert!(children.iter().all(|(_, number)| !lives(*number)));
    assert!(bench.run_ids().is_empty());
    assert_eq!(shared_objects(&id), 0);
    let session = report["session"].as_str().unwrap();
    let info = bench.call(&["info", session, "--json"]).good();
    assert_eq!((&info["ended"], &info["complete"]), (&json!("in order"), &json!(true)));
    assert_eq!(info["ledger"], report["ledger"], "the recorded ledger is the printed one");
}

#[test]
fn ctrl_c_ends_a_run_in_order() {
    ends_in_order(Signal::INT);
}

#[test]
fn sigterm_ends_a_run_in_order() {
    ends_in_order(Signal::TERM);
}

#[test]
fn ctrl_c_during_start_up_leaves_nothing() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("chain.yaml"));
    wait_for("a child", || (!run.children().is_empty()).then_some(()));
    let id = bench.run_ids().pop().unwrap();

    run.signal_group(Signal::INT);
    let done = run.finish();

    // Where start-up was nearly over the run ends like any other.
    if done.code() == 0 {
        assert_eq!(
            (&done.json()["ended_early"], &done.json()["balanced"]),
            (&json!("stopped"), &json!(true))
        );
    } else {
        assert!(done.err.contains("stopped while it was starting"), "{}", done.err);
    }
    assert!(bench.run_ids().is_empty());
    assert_eq!(shared_objects(&id), 0);
}

#[test]
fn ctrl_c_ends_a_start_up_that_hangs() {
    let bench = Bench::new();
    let run = bench.start(&["run", text(&pipeline("fragile.yaml")), "--set", "fragile.way=hang"]);
    let id = wait_for("the run's folder", || bench.run_ids().pop());
    let child = run.child("fragile", 0);

    run.signal_group(Signal::INT);
    let done = run.finish();

    assert_eq!(done.code(), 1);
    assert!(done.err.contains("stopped while it was starting"), "{}", done.err);
    assert!(!lives(child));
    assert!(bench.run_ids().is_empty());
    assert_eq!(shared_objects(&id), 0);
}

#[test]
fn ctrl_c_ends_a_run_whose_step_never_comes_back() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("stuck.yaml"));
    bench.wait_for_samples("beat.value", 50);
    let done = run.stop();
    assert_eq!(done.code(), 1, "{}", done.err);
    let report = done.json();
    assert_eq!(report["ended_early"], "stuck did not stop when told, and was killed");
    assert_eq!(report["balanced"], true);
    bench.call(&["replay", report["session"].as_str().unwrap(), "--json"]).good();
}

/// Kills the supervisor of a run, and waits until its children have ended by themselves.
fn bereave(run: Running) {
    let children = run.children();
    assert!(children.len() > 1);
    run.signal(Signal::KILL);
    run.finish();
    wait_for("the children's ends", || children.iter().all(|(_, n)| !lives(*n)).then_some(()));
}

#[test]
fn children_end_when_the_supervisor_is_killed_and_the_next_run_sweeps() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 20);
    let id = bench.run_ids().pop().unwrap();
    bereave(run);
    assert!(shared_objects(&id) > 0, "a killed supervisor cannot clean up");

    let next =
        bench.call(&["run", text(&pipeline("sources.yaml")), "--for", "300 ms", "--json", "--no-record"]);

    assert_eq!(next.good()["swept"], json!([id]));
    assert_eq!(shared_objects(&id), 0);
    assert!(bench.run_ids().is_empty());
    // What was recorded is whole, and says why it is not complete.
    let session = bench.path("s/chain-0001");
    let info = bench.call(&["info", text(&session), "--json"]).good();
    assert!(info["gaps"].as_array().unwrap().contains(&json!("the supervisor died")), "{}", info["gaps"]);
    let replay = bench.call(&["replay", text(&session), "--json"]);
    assert_eq!(replay.json()["differences"], 0);
    assert!(replay.json()["identical"]["sink.sum"].as_u64().unwrap() >= 20);
}

#[test]
fn a_child_whose_step_never_comes_back_ends_with_its_supervisor() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("stuck.yaml"));
    bench.wait_for_samples("beat.value", 50);
    bereave(run);
}

#[test]
fn a_sweep_leaves_runs_that_go_on_alone() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 5);
    let other =
        bench.call(&["run", text(&pipeline("sources.yaml")), "--for", "200 ms", "--json", "--no-record"]);
    assert_eq!(other.good()["swept"], json!([]));
    bench.wait_for_samples("sink.sum", 5);
    run.stop().good();
}
