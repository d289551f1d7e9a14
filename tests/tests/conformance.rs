//! The two equalities, for every pipeline and to the byte: simulated = lock-step in threads = lock-step in processes,
//! and replay(live) = live.

use crate::bench::{Bench, pipeline, text};

/// Runs a pipeline simulated, and in lock-step on both placements, and compares the recordings as files.
fn placements_agree(name: &str) {
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

conform!(fan sync timers cycle crash sources);
