//! A training over a pool of workers gives the weights of a training in one process.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

#[path = "../../../../stages/planning/network/tests/common/mod.rs"]
#[allow(dead_code)]
mod common;
#[path = "../../../../stages/planning/pool/tests/simulated.rs"]
#[allow(dead_code)]
mod simulated;

use std::num::NonZeroUsize;
use std::sync::Mutex;

use common::patient;
use simulated::{CALM, Part, Simulated, build};
use stillpoint_network::{Rules, Sizes};
use stillpoint_pool::{ClientSettings, Pool};
use stillpoint_train::planner::{Here, Options, Players, Pooled, Progress, Schedule, Weights, train};

/// Spacing of the doses: coarse, so that games are short.
const GRID_MM: f64 = 24.0;
const RULES: Rules = Rules { beams: 5, class: false, rotations: 1, proposed: 0, search: 6, random: 1 };

/// Two openings, a round of two games, and examinations.
fn schedule() -> Schedule {
    let with_network = Rules { proposed: 1, ..RULES };
    Schedule {
        train: vec![patient(1, GRID_MM), patient(2, GRID_MM)],
        validate: vec![patient(3, GRID_MM)],
        test: Vec::new(),
        rounds: vec![vec![patient(4, GRID_MM), patient(5, GRID_MM)]],
        start: 1,
        passes: 1,
        end: 1,
        buffer: 4,
        opening: RULES,
        game: with_network,
        reference: RULES,
        exam: Rules { search: 0, random: 0, ..with_network },
        seed: 5,
    }
}

/// The bytes of the trained network, and the games that were in doubt.
fn weights(players: &mut dyn Players) -> (Vec<u8>, Vec<String>) {
    let folder = tempfile::tempdir().unwrap();
    let options = Options {
        sizes: Sizes { structure: 4, ring: 8, angle: 8, neighbour: 4, pair: 8, set: 6, layers: 2 },
        weights: Weights { mse: 100.0, ce: 0.3, lambda: 1e-6 },
        sets: 8,
        states: 2,
        ..Options::default()
    };
    let doubtful = Mutex::new(Vec::new());
    let report = |reported| {
        if let Progress::Doubt(names) = reported {
            doubtful.lock().unwrap().extend(names);
        }
    };
    let trained = train(&schedule(), &options, folder.path(), players, &report).unwrap();
    (trained.model.to_safetensors().unwrap(), doubtful.into_inner().unwrap())
}

fn pooled(checked: f64, parts: &[Part]) -> Pooled<Simulated> {
    let settings = ClientSettings { checked, ..ClientSettings::new(build()) };
    Pooled::new(Pool::new(Simulated::new(1, CALM, parts), settings), NonZeroUsize::MIN)
}

#[test]
fn weights_are_the_same_with_no_worker_with_one_that_is_killed_and_with_two_of_which_one_lies() {
    let (expected, _) = weights(&mut Here(NonZeroUsize::MIN));
    let dying = Part { dies_after: 2, ..Part::default() };
    for parts in [vec![], vec![dying]] {
        let mut players = pooled(0.1, &parts);
        assert!(weights(&mut players) == (expected.clone(), Vec::new()), "{} workers", parts.len());
        let pool = players.pool();
        assert_eq!(
            (pool.tally().remote > 0, pool.courier().deaths > 0),
            (!parts.is_empty(), !parts.is_empty())
        );
    }
    // Its first games are right, and openings of it are trained on when a game of it is found to be wrong.
    let mut players = pooled(0.3, &[Part { wrong_from: 3, ..Part::default() }, Part::default()]);
    let (found, doubtful) = weights(&mut players);
    assert!(players.pool().workers()["w0"].shut_out.is_some());
    assert!(!doubtful.is_empty());
    assert!(found == expected);
}
