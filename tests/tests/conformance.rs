//! The two equalities, for every pipeline and to the byte: simulated = lock-step in threads = lock-step in processes,
//! and replay(live) = live.

use crate::bench::{Bench, pipeline, text};

/// Runs a pipeline simulated, and in lock-step on both placements, and compares the recordings as files.
pub fn placements_agree(name: &str) {
    let bench = Bench::new();
    let file = pipeline(name);
    let placements: [&[&str]; 3] =
        [&["--clock", "simulated"], &["--lock-step=threads"], &["--lock-step=processes"]];
    let recordings = placements.map(|placement| {
        let arguments =
            [&["run", text(&file), "--for", "1 s", "--json", "--record", "s"], placement].concat();
        let report = bench.call(&arguments).good();
        assert_eq!(report["balanced"], true);
        let activations: u64 =
            report["operators"].as_array().unwrap().iter().map(|o| o["activations"].as_u64().unwrap()).sum();
        assert!(activations > 100, "{activations} activations show nothing");
        let session = bench.path(report["session"].as_str().unwrap());
        std::fs::read(session.join("part-000.mcap")).unwrap()
    });
    assert!(recordings[0] == recordings[1], "threads differ from the simulation");
    assert!(recordings[0] == recordings[2], "processes differ from the simulation");
}

/// Runs a pipeline live and replays it.
fn live_replays(name: &str) {
    let bench = Bench::new();
    let report =
        bench.call(&["run", text(&pipeline(name)), "--for", "1500 ms", "--json", "--record", "s"]).good();
    assert_eq!(report["balanced"], true, "{}", report["ledger"]);
    let session = report["session"].as_str().unwrap();
    let replay = bench.call(&["replay", session, "--json"]).good();
    assert_eq!(replay["identical_all"], true);
    assert_eq!(replay["open"], serde_json::json!([]));
    let of_run: u64 =
        report["operators"].as_array().unwrap().iter().map(|o| o["activations"].as_u64().unwrap()).sum();
    let sources = ["source", "fast", "slow", "left", "right", "odd", "seed"];
    let of_sources: u64 = report["operators"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|o| sources.contains(&o["operator"].as_str().unwrap()))
        .map(|o| o["activations"].as_u64().unwrap())
        .sum();
    assert_eq!(replay["activations"].as_u64().unwrap(), of_run - of_sources, "each activation is done again");
    let info = bench.call(&["info", session, "--json"]).good();
    assert_eq!(info["complete"], true, "{}", info["gaps"]);
}

/// Beginnings of an operator's incarnations, ms of session time.
fn begun(bench: &Bench, session: &str, operator: &str) -> Vec<u64> {
    let journal = crate::live::journal(bench, session, operator);
    journal.iter().filter(|e| e["cause"] == 0).map(|e| e["stamp"].as_u64().unwrap() / 1_000_000).collect()
}

#[test]
fn a_deadline_and_the_wait_before_a_restart_pass_in_logical_time_on_every_placement() {
    let bench = Bench::new();
    let file = pipeline("deadline.yaml");
    let placements: [&[&str]; 3] =
        [&["--clock", "simulated"], &["--lock-step=threads"], &["--lock-step=processes"]];
    let recordings = placements.map(|placement| {
        let arguments =
            [&["run", text(&file), "--for", "1 s", "--json", "--record", "s"], placement].concat();
        let done = bench.call(&arguments);
        assert_eq!(done.code(), 1, "{}", done.err);
        let report = done.json();
        assert_eq!(
            report["ended_early"],
            "operator late: a step takes 30000 us, longer than its deadline of 20000 us; it was restarted 2 times \
             already"
        );
        assert_eq!(report["balanced"], true, "{}", report["ledger"]);
        let late = crate::bench::figures(&report, "late");
        assert_eq!((&late["activations"], &late["incarnations"]), (&0.into(), &3.into()));
        let session = report["session"].as_str().unwrap().to_owned();
        // The deadline, and 100 ms, and then 200 ms: of the whole group.
        for operator in ["late", "mate"] {
            assert_eq!(begun(&bench, &session, operator), [0, 120, 340], "{operator}");
        }
        let replay = bench.call(&["replay", &session, "--json"]).good();
        assert_eq!(replay["differences"], 0);
        std::fs::read(bench.path(&session).join("part-000.mcap")).unwrap()
    });
    assert!(recordings[0] == recordings[1], "threads differ from the simulation");
    assert!(recordings[0] == recordings[2], "processes differ from the simulation");
}

#[test]
fn a_panic_waits_in_logical_time_and_ends_a_simulation_by_the_same_policy() {
    let bench = Bench::new();
    let arguments = ["run", "--clock", "simulated", "--for", "5 s", "--json", "--record", "s"];
    let file = pipeline("tired.yaml");
    let done = bench.call(&[&arguments[..], &[text(&file)]].concat());
    assert_eq!(done.code(), 1);
    let report = done.json();
    assert_eq!(
        report["ended_early"],
        "operator tired: the mixer panics at activation 60; it was restarted 2 times already"
    );
    // Sample 60 comes at 300 ms, and 100 ms are waited. Four samples wait then; 57 more, 5 ms apart, end at 685 ms, and
    // 200 ms are waited.
    assert_eq!(begun(&bench, report["session"].as_str().unwrap(), "tired"), [0, 400, 885]);
}

macro_rules! conform {
    ($($pipeline:ident)*) => {$(
        mod $pipeline {
            #[test]
            fn simulated_and_lock_step_write_the_same_bytes() {
                super::placements_agree(concat!(stringify!($pipeline), ".yaml"));
            }

            #[test]
            fn a_live_session_replays_bit_for_bit() {
                super::live_replays(concat!(stringify!($pipeline), ".yaml"));
            }
        }
    )*};
}

conform!(fan sync timers cycle crash sources laps finishing);
