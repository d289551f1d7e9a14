//! What iceoryx2 does to samples of the dead, and why ours stay.

use crate::bench::{Bench, line, pipeline, wait_for};

#[test]
fn an_operator_killed_at_any_moment_after_its_restart_leaves_no_orphans() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 5);
    let mut last = 0;
    for round in 0..12u32 {
        last = run.kill("middle", last);
        let number = run.child("middle", last);
        // Some die while they make their ports, some at their first activations, some at work.
        let entries = round % 4;
        if entries > 0 {
            let life = round + 1;
            wait_for("its activations", || {
                let line = bench.wait_for_samples("middle.journal", 1);
                let entry: serde_json::Value = serde_json::from_str(line.lines().next()?).ok()?;
                let lives = entry["incarnation"].as_u64()? >= u64::from(life) || !crate::bench::lives(number);
                lives.then_some(())
            });
        }
    }
    run.child("middle", last);
    bench.wait_for_samples("sink.sum", 5);
    let report = run.stop().good();
    assert_eq!(report["balanced"], true, "{}", report["ledger"]);
    assert_eq!(report["unseen_entries"], 0);
    assert_eq!(line(&report, "sink.queue")["unexplained"], 0);
    let session = report["session"].as_str().unwrap();
    let info = bench.call(&["info", session, "--json"]).good();
    assert_eq!(info["complete"], true, "{}", info["gaps"]);
    let replay = bench.call(&["replay", session, "--json"]).good();
    assert_eq!(replay["identical_all"], true);
}
