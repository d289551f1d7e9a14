//! The ledger: sent = received + accounted loss, edge by edge.

use serde_json::Value;

use crate::bench::{Bench, line, pipeline, wait_for};

/// Samples that a producer's newest incarnation has sent, as its journal says.
fn sent(bench: &Bench, operator: &str) -> u64 {
    let entry = bench.wait_for_samples(&format!("{operator}.journal"), 1);
    let entry: Value = serde_json::from_str(entry.lines().next().unwrap()).unwrap();
    let outputs = entry["elements"].as_array().unwrap();
    outputs.iter().filter(|r| r["kind"] == 2).filter_map(|r| r["total"].as_u64()).max().unwrap_or(0)
}

#[test]
fn nothing_is_unexplained_over_overflow_used_up_memory_kills_and_start_up() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("flood.yaml"));
    wait_for("a flood", || (sent(&bench, "flood") > 10_000).then_some(()));
    let mut last = 0;
    for _ in 0..3 {
        last = run.kill("wide", last);
    }
    run.child("wide", last);
    let narrow = run.kill("narrow", 0);
    run.child("narrow", narrow);
    let before = run.kill("flood", 0);
    run.child("flood", before);
    wait_for("a longer flood", || (sent(&bench, "flood") > 45_000).then_some(()));
    let before = run.kill("flood", before);
    run.child("flood", before);
    wait_for("the last flood", || (sent(&bench, "flood") > 45_000).then_some(()));

    // A flood that the recorder cannot keep up with leaves its session incomplete, and its ledger balanced.
    let report = run.stop().json();
    assert_eq!(report["balanced"], true);

    for entry in report["ledger"].as_array().unwrap() {
        assert_eq!(entry["unexplained"], 0, "{entry}");
        let n = |key: &str| entry[key].as_u64().unwrap();
        assert_eq!(
            n("sent"),
            n("received") + n("overwritten") + n("pool_exhausted") + n("down") + n("left"),
            "{entry}"
        );
    }
    assert!(line(&report, "wide.queue")["sent"].as_u64().unwrap() >= 100_000);
    assert!(line(&report, "narrow.queue")["overwritten"].as_u64().unwrap() > 10_000);
    // What an activation sends beyond its memory takes the place of what it sent before.
    let second = line(&report, "wide.second");
    assert_eq!(second["pool_exhausted"], 0, "{second}");
    assert!(
        second["overwritten"].as_u64().unwrap() + second["received"].as_u64().unwrap() > 10_000,
        "{second}"
    );
    let session = report["session"].as_str().unwrap();
    let replay = bench.call(&["replay", session, "--json"]);
    assert_eq!(replay.json()["differences"], 0);
}

#[test]
fn start_up_loses_nothing() {
    let bench = Bench::new();
    for _ in 0..3 {
        let file = pipeline("chain.yaml");
        let report = bench
            .call(&["run", crate::bench::text(&file), "--for", "200 ms", "--json", "--no-record"])
            .good();
        for consumer in ["middle.queue", "sink.queue"] {
            let account = line(&report, consumer);
            assert_eq!((&account["down"], &account["left"]), (&0.into(), &0.into()), "{account}");
            assert_eq!(
                account["sent"].as_u64().unwrap() - account["received"].as_u64().unwrap(),
                account["overwritten"].as_u64().unwrap()
            );
        }
    }
}
