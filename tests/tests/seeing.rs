//! A head followed live against a reference that a person captures, recorded and replayed.

use serde_json::Value;

use crate::bench::{Bench, pipeline};

fn samples(bench: &Bench, topic: &str, session: &str) -> Vec<Value> {
    let done = bench.call(&["echo", topic, "--session", session]);
    assert_eq!(done.code(), 0, "{}", done.err);
    done.out.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// The status of each report: 0 no reference, 1 captured, 2 tracked.
fn statuses(reports: &[Value]) -> Vec<u64> {
    reports.iter().map(|r| r["elements"][0]["status"].as_u64().unwrap()).collect()
}

#[test]
fn a_live_capture_makes_the_reference_and_the_session_replays_bit_for_bit() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("seeing.yaml"));
    bench.wait_for_samples("head.report", 2);
    assert_eq!(bench.call(&["send", "console.capture"]).code(), 0);
    bench.wait_for_samples("filter.state", 5);
    let report = run.stop().good();
    assert_eq!(report["balanced"], true, "{}", report["ledger"]);
    let session = report["session"].as_str().unwrap();

    let reports = samples(&bench, "head.report", session);
    let statuses = statuses(&reports);
    let captured = statuses.iter().position(|s| *s == 1).expect("a face became the reference");
    assert!(captured >= 2 && statuses[..captured].iter().all(|s| *s == 0), "{statuses:?}");
    assert!(statuses[captured + 1..].iter().all(|s| *s == 2), "{statuses:?}");
    assert_eq!(samples(&bench, "head.reference", session).len(), 1);
    assert_eq!(samples(&bench, "head.pose", session).len(), statuses.len() - captured);

    let accuracy = &report["accuracy"];
    assert!(accuracy["worst_mm"].as_f64().unwrap() < 1.0, "{accuracy}");
    assert!(accuracy["turns"]["worst_deg"].as_f64().unwrap() < 1.0, "{accuracy}");

    let replay = bench.call(&["replay", session, "--json"]).good();
    assert_eq!(replay["identical_all"], true, "{replay}");
    for topic in ["head.pose", "head.report", "head.reference", "filter.state"] {
        assert!(replay["identical"].get(topic).is_some(), "{topic}: {replay}");
    }
}
