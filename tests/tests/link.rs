//! Links: edges that leave as datagrams in a live run, and what outlives a supervisor.

use std::net::UdpSocket;
use std::path::PathBuf;

use rustix::process::Signal;
use serde_json::Value;

use crate::bench::{Bench, figures, lives, pipeline, text, wait_for};
use crate::live::journal;

/// The pipeline `link.yaml` with a port that nobody listens at, and the port.
fn on_a_free_port(bench: &Bench) -> (PathBuf, String) {
    let free = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    let yaml = std::fs::read_to_string(pipeline("link.yaml")).unwrap().replace("127.0.0.1:5005", &free);
    let path = bench.path("link.yaml");
    std::fs::write(&path, yaml).unwrap();
    (path, free)
}

fn last(samples: &str, name: &str) -> f64 {
    let sample: Value = serde_json::from_str(samples.lines().last().unwrap()).unwrap();
    let metrics = sample["elements"].as_array().unwrap();
    metrics.iter().find(|m| m["name"] == name).unwrap()["value"].as_f64().unwrap()
}

#[test]
fn datagrams_cross_the_wire_strangers_are_recorded_and_the_session_replays() {
    let bench = Bench::new();
    let (file, address) = on_a_free_port(&bench);
    let run = bench.run(&file);
    bench.wait_for_samples("reader.read", 20);
    let stranger = UdpSocket::bind("127.0.0.1:0").unwrap();
    stranger.send_to(b"not a letter", &address).unwrap();
    stranger.send_to(&[7; 1025], &address).unwrap();
    bench.wait_for_samples("reader.read", 20);
    let report = run.stop().good();
    assert_eq!(report["balanced"], true, "{}", report["ledger"]);
    let session = report["session"].as_str().unwrap();
    let written = figures(&report, "writer")["activations"].as_u64().unwrap() as f64;
    let read = bench.call(&["echo", "--json", "reader.read", "--session", session]).out;
    assert_eq!(last(&read, "strangers"), 1.0);
    // What was on the wire when the far end stopped is not read any more.
    assert!(
        last(&read, "letters") > written - 20.0 && last(&read, "letters") <= written,
        "{written}: {read}"
    );
    let refused = bench.call(&["echo", "--json", "writer_letter.diagnostics", "--session", session]).out;
    assert_eq!(last(&refused, "too_long"), 1.0);
    let replay = bench.call(&["replay", session, "--json"]).good();
    assert_eq!(replay["identical_all"], true);
    assert_eq!(replay["open"], serde_json::json!([]));
}

#[test]
fn a_far_end_outlives_its_supervisor_and_the_session_holds_it() {
    let bench = Bench::new();
    let (file, _) = on_a_free_port(&bench);
    let run = bench.run(&file);
    bench.wait_for_samples("reader.read", 20);
    let children = run.children();
    run.signal(Signal::KILL);
    run.finish();
    wait_for("the children's ends", || children.iter().all(|(_, n)| !lives(*n)).then_some(()));
    let session = bench.path("s/link-0001");
    let stamps = |operator: &str| -> Vec<u64> {
        journal(&bench, text(&session), operator).iter().map(|e| e["stamp"].as_u64().unwrap()).collect()
    };
    let (writer, reader) = (stamps("writer"), stamps("reader"));
    let outlived = (reader.last().unwrap() - writer.last().unwrap()) / 1_000_000;
    assert!((300..800).contains(&outlived), "{outlived} ms");
    let ends = journal(&bench, text(&session), "reader");
    assert_eq!(ends.last().unwrap()["cause"], 4, "its end is marked");
    let info = bench.call(&["info", text(&session), "--json"]).good();
    assert!(info["gaps"].as_array().unwrap().contains(&serde_json::json!("the supervisor died")));
    let replay = bench.call(&["replay", text(&session), "--json"]);
    assert_eq!(replay.json()["differences"], 0);
}

#[test]
fn two_runs_at_one_port_are_refused_with_words() {
    let bench = Bench::new();
    let (file, address) = on_a_free_port(&bench);
    let taken = UdpSocket::bind(&address).unwrap();
    let done = bench.call(&["run", text(&file), "--for", "200 ms", "--no-record"]);
    assert_ne!(done.code(), 0);
    assert!(done.err.contains(&address) && done.err.contains("another port"), "{}", done.err);
    drop(taken);
}

#[test]
fn where_a_run_is_not_live_a_link_is_an_edge_with_a_delay() {
    crate::conformance::placements_agree("link.yaml");
}

#[test]
fn where_a_run_is_not_live_an_edge_between_hosts_needs_no_network() {
    crate::conformance::placements_agree("hosts.yaml");
}
