//! Runs whose words nobody hears: the terminal is gone, the run goes on.

use serde_json::json;

use crate::bench::{Bench, pipeline, signal, text};

#[test]
fn a_run_that_nobody_hears_goes_on_when_a_worker_dies() {
    let bench = Bench::new();
    let run = bench.start_unheard(&["run", text(&pipeline("chain.yaml")), "--record", "s"]);
    bench.wait_for_samples("sink.sum", 10);
    let first = run.child("middle", 0);
    signal(first, rustix::process::Signal::KILL);
    crate::bench::wait_for("another incarnation", || {
        run.children().iter().find(|(name, number)| name == "middle" && *number != first).map(drop)
    });
    bench.wait_for_samples("sink.sum", 10);
    let done = run.stop();
    assert_eq!(done.code(), 0, "{:?} {}", done.status, done.out);
    assert!(done.out.contains("the ledger balances"), "{}", done.out);
    let info = bench.call(&["info", text(&bench.path("s/chain-0001")), "--json"]).good();
    assert_eq!(info["ended"], json!("in order"));
}
