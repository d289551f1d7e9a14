//! People break a running rig and mend it, from camera to valve, live: it is recorded, and a replay has it.

use serde_json::Value;

use crate::bench::{Bench, small_loop, text, wait_for};

const PIPELINE: &str = include_str!("../../pipeline.yaml");
/// What a person says to `stillpoint send console.fault`, and the bit of `rig.state` that comes of it.
const FAULTS: [(&[&str], u64); 6] = [
    (&["blind_camera"], 8),
    (&["silent_camera"], 16),
    (&["stuck_valve", "3"], 1),
    (&["leak", "2", "0.0002"], 2),
    (&["weak_supply", "0", "0.8"], 4),
    (&["lost_duties", "0", "0.5"], 32),
];

/// What a person does is the same however late a busy machine is.
const PATIENT: [&str; 7] = [
    "valves.life=1 s",
    "valves.watchdog=5 s",
    "valves.patience=10 min",
    "valves.pose.frame_period=500 ms",
    "gate.pose.frame_period=500 ms",
    "law.stale=5 s",
    "rig.time_to_live=1 s",
];
const VENTING: u64 = 1;
const FOLLOWING: u64 = 2;

/// The newest sample of a topic of the run, once there is one.
fn newest(bench: &Bench, topic: &str) -> Option<Value> {
    let done = bench.call(&["echo", "--json", topic, "--count", "1"]);
    let sample: Value = serde_json::from_str(done.out.lines().next()?).ok()?;
    Some(sample["elements"][0].clone())
}

fn send(bench: &Bench, what: &[&str]) {
    let sent = bench.call(&[&["send", "console.fault"], what].concat());
    assert_eq!(sent.code(), 0, "{what:?}: {}", sent.err);
}

fn wait_for_faults(bench: &Bench, bits: u64) {
    wait_for(&format!("the faults {bits}"), || {
        newest(bench, "rig.state").filter(|state| state["faults"] == bits).map(drop)
    });
}

/// Waits until the far end follows what it is sent.
fn wait_until_followed(bench: &Bench) {
    wait_for("the far end to follow", || {
        if newest(bench, "far.state")?["doing"] == FOLLOWING {
            return Some(());
        }
        // The script's arm may have come too early, and a loop that stood still waits for a person.
        for output_text in ["console.resume", "console.arm"] {
            bench.call(&["send", output_text]);
        }
        None
    });
}

#[test]
fn what_a_person_breaks_acts_until_it_is_mended_and_the_session_replays_bit_for_bit() {
    let bench = Bench::new();
    let file = small_loop(&bench, PIPELINE, "examples/data/rig.key");
    let sets = PATIENT.iter().flat_map(|set| ["--set", set]).collect::<Vec<_>>();
    let run = bench.start(&[&["run", text(&file), "--json", "--record", "s"], &sets[..]].concat());
    wait_until_followed(&bench);
    for (number, (what, bit)) in FAULTS.iter().enumerate() {
        send(&bench, what);
        wait_for_faults(&bench, *bit);
        if number == 0 {
            // Nobody sees the head: the valves vent.
            wait_for("the vent", || {
                newest(&bench, "far.state")
                    .filter(|far| far["doing"] == VENTING && far["beam"] == 0)
                    .map(drop)
            });
        }
        send(&bench, &["mend"]);
        wait_for_faults(&bench, 0);
    }
    // A valve that there is not is refused before it is sent.
    let absent = bench.call(&["send", "console.fault", "stuck_valve", "6"]);
    assert_eq!((absent.code(), absent.err.contains("6 (allowed: 0 to 5)")), (2, true), "{}", absent.err);
    wait_until_followed(&bench);
    let report = run.stop().good();
    assert_eq!(report["balanced"], true, "{}", report["ledger"]);

    let session = report["session"].as_str().unwrap();
    let echo = |topic: &str| -> Vec<Value> {
        let done = bench.call(&["echo", "--json", topic, "--session", session]);
        done.out.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    };
    // What people said is in the session, in their order, and what came of it.
    let output_text: Vec<f64> =
        echo("console.fault").iter().map(|s| s["elements"][0]["values"][0].as_f64().unwrap()).collect();
    let due = FAULTS.iter().flat_map(|(_, bit)| [*bit as f64, 0.0]);
    assert_eq!(output_text, due.collect::<Vec<_>>());
    let states = echo("rig.state");
    let mut acted: Vec<u64> = states.iter().map(|s| s["elements"][0]["faults"].as_u64().unwrap()).collect();
    acted.dedup();
    let due = FAULTS.iter().flat_map(|(_, bit)| [0, *bit]).chain([0]);
    assert_eq!(acted, due.collect::<Vec<_>>());

    let replay = bench.call(&["replay", session, "--json"]).good();
    assert_eq!((&replay["identical_all"], &replay["open"]), (&true.into(), &serde_json::json!([])));
    assert_eq!(replay["identical"]["rig.state"], states.len());
}

#[test]
fn a_fault_that_there_is_not_is_named_before_it_is_sent() {
    let bench = Bench::new();
    for (what, words) in [
        (&["leek", "0"][..], "did you mean leak?"),
        (&[], "which fault?"),
        (&["leak", "one"], "`one` is not a number"),
        (&["leak", "0", "nan"], "`nan` is not a number"),
    ] {
        let done = bench.call(&[&["send", "console.fault"], what].concat());
        assert_ne!(done.code(), 0);
        assert!(done.err.contains(words), "{what:?}: {}", done.err);
    }
}
