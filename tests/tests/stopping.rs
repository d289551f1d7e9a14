//! Runs on the discrete-event schedule that somebody stops, or that cannot begin.

use std::os::unix::process::ExitStatusExt;
use std::path::Path;

use rustix::process::Signal;
use serde_json::json;

use crate::bench::{Bench, Running, line, lives, pipeline, text, wait_for};

/// Begins a run in a placement, and waits until it is under way.
fn in_transit(bench: &Bench, file: &Path, placement: &[&str]) -> Running {
    let run = ["run", text(file), "--for", "1 h", "--json", "--record", "s"];
    let run = bench.start(&[&run, placement].concat());
    wait_for("the session", || {
        let session = std::fs::read_dir(bench.path("s")).ok()?.next()?.ok()?.path();
        (session.join("part-000.mcap").metadata().ok()?.len() > 0).then_some(())
    });
    run
}

fn ends_in_order(placement: &[&str], signal: impl Fn(&Running)) {
    let bench = Bench::new();
    // Much is under way at the end.
    let yaml = std::fs::read_to_string(pipeline("chain.yaml")).unwrap();
    let late = yaml.replace("from: middle.sum, queue: 16", "from: middle.sum, delay: 900 ms, queue: 16");
    std::fs::write(bench.path("chain.yaml"), late).unwrap();
    let run = in_transit(&bench, &bench.path("chain.yaml"), placement);
    let children = run.children();

    signal(&run);
    let report = run.finish().good();

    assert_eq!((&report["ended_early"], &report["balanced"]), (&json!("stopped"), &json!(true)));
    assert_eq!(line(&report, "sink.queue")["left"], 0, "drained");
    assert!(report["seconds"].as_f64().unwrap() < 3600.0, "{}", report["seconds"]);
    assert_eq!(report["faults"], json!([]));
    assert!(children.iter().all(|(_, number)| !lives(*number)));
    assert!(bench.run_ids().is_empty());
    let session = report["session"].as_str().unwrap();
    let info = bench.call(&["info", session, "--json"]).good();
    assert_eq!((&info["ended"], &info["complete"]), (&json!("in order"), &json!(true)), "{}", info["gaps"]);
    assert_eq!(info["ledger"], report["ledger"], "the recorded ledger is the printed one");
    let replay = bench.call(&["replay", session, "--json"]);
    assert_eq!(replay.json()["differences"], 0, "{}", replay.err);
}

#[test]
fn ctrl_c_ends_a_simulated_run_in_order() {
    ends_in_order(&["--clock", "simulated"], |run| run.signal_group(Signal::INT));
}

#[test]
fn sigterm_ends_a_run_in_lock_step_in_threads_in_order() {
    ends_in_order(&["--lock-step=threads"], |run| run.signal_group(Signal::TERM));
}

#[test]
fn a_hang_up_ends_a_run_in_lock_step_in_processes_in_order() {
    ends_in_order(&["--lock-step=processes"], |run| run.signal_group(Signal::HUP));
}

#[test]
fn hang_ups_that_come_at_once_end_runs_in_order() {
    for placement in [&["--clock", "simulated"][..], &["--lock-step=processes"]] {
        ends_in_order(placement, Running::hang_up_repeatedly);
    }
}

#[test]
fn a_simulated_run_whose_step_never_comes_back_ends_by_a_further_signal() {
    let bench = Bench::new();
    let run = in_transit(&bench, &pipeline("stuck.yaml"), &["--clock", "simulated"]);
    wait_for("the step", || run.has_answered("the kit hangs").then_some(()));
    wait_for("its end", || {
        run.signal(Signal::TERM);
        (!lives(run.pid())).then_some(())
    });
    assert_eq!(run.finish().status.signal(), Some(15));
}

#[test]
fn a_run_whose_operator_cannot_be_made_leaves_nothing() {
    let bench = Bench::new();
    let file = pipeline("fragile.yaml");
    for placement in [&["--clock", "simulated"][..], &["--lock-step=threads"], &["--lock-step"]] {
        let run =
            ["run", text(&file), "--set", "fragile.interruption=error", "--for", "1 h", "--record", "s"];
        let done = bench.call(&[&run, placement].concat());
        assert_eq!(done.code(), 1, "{}", done.err);
        assert!(done.err.contains("the kit's model has 3 layers"), "{}", done.err);
        assert!(!bench.path("s/fragile-0001").exists(), "a session of a run that did not begin");
        assert!(bench.run_ids().is_empty());
    }
}
