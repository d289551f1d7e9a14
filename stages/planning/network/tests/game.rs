//! Games: the same bytes for the same weights, patient and seed, and what is in them.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod common;

use std::num::NonZeroUsize;

use common::{model, patient};
use serde_json::{Value, json};
use stillpoint_network::game::{play, ring};
use stillpoint_network::patient::{Body, Table};
use stillpoint_network::{Coarseness, Game, Patient, Rules};

const RULES: Rules = Rules { beams: 5, class: true, rotations: 3, proposed: 3, search: 9, random: 2 };

#[test]
fn a_game_depends_on_weights_patient_seed_and_rules_alone() {
    let model = model();
    let bytes = |seed, threads| {
        let threads = NonZeroUsize::new(threads).unwrap();
        play(Some(&model), &patient(1, 12.0), seed, RULES, threads).unwrap().to_bytes().unwrap()
    };
    let first = bytes(1, 1);
    assert_eq!(first, bytes(1, 2), "threads change nothing");

    let game = Game::from_bytes(&first).unwrap();
    // Another seed searches elsewhere.
    assert_ne!(game.sets, Game::from_bytes(&bytes(2, 1)).unwrap().sets);
    assert_eq!(game.to_bytes().unwrap(), first);
    assert_eq!(game.network.as_deref(), Some(model.hash().unwrap().as_str()));
    assert_eq!((game.rotations.len(), game.proposed.len()), (3, 3));
    let ring = ring().unwrap();
    assert!(game.sets.iter().all(|(set, _)| ring.set(set).is_ok() && set.len() == 5));
    let cost = |angles: [f64; 5]| {
        let set = ring.set(&angles.map(|angle| ring.nearest(angle))).unwrap();
        game.sets.iter().find(|(found, _)| found == set.beams()).map(|(_, cost)| *cost)
    };
    // The class set, and the first rotation of equal beams.
    assert_eq!(cost([44.0, 92.0, 120.0, 252.0, 336.0]), game.class);
    assert_eq!(cost([0.0, 72.0, 144.0, 216.0, 288.0]), Some(game.rotations[0]));
    assert!(game.best() <= game.proposed.iter().copied().fold(f64::INFINITY, f64::min));
    // 1 + 3 + 3, the search less sets of four, and 2; some may be the same.
    assert!((10..=18).contains(&game.sets.len()), "{}", game.sets.len());
}

#[test]
fn bytes_that_are_no_game_are_refused() {
    let rules = Rules { search: 0, random: 0, ..RULES };
    let game = play(None, &patient(3, 12.0), 1, rules, NonZeroUsize::MIN).unwrap();
    let bytes = game.to_bytes().unwrap();
    assert_eq!(Game::from_bytes(&bytes).unwrap(), game);
    let whole: Value = serde_json::from_slice(&bytes).unwrap();
    let refused = |change: fn(&mut Value)| {
        let mut value = whole.clone();
        change(&mut value);
        Game::from_bytes(&serde_json::to_vec(&value).unwrap()).unwrap_err().to_string()
    };
    assert!(refused(|game| game["version"] = json!(9)).contains("version 9"));
    assert!(refused(|game| game["sets"][0][0][4] = json!(91)).contains("angle number 91"));
    assert!(refused(|game| game["sets"][0][0] = json!([40, 30, 20, 10, 0])).contains("do not rise"));
    assert!(refused(|game| game["sets"][0][0] = json!([0, 30])).contains("another number of beams"));
    assert!(refused(|game| game["class"] = json!(-1)).contains("not above 0"));
    assert!(refused(|game| game["rotations"][0] = json!(0)).contains("not above 0"));
    assert!(refused(|game| game["other"] = json!(1)).contains("unknown field"));
    assert!(Game::from_bytes(&bytes[..40]).is_err());
}

#[test]
fn a_problem_counts_every_structure_by_its_volume() {
    let coarse = Coarseness { grid_mm: 8.0, bixel_mm: 24.0 };
    for patient in [
        Patient { body: Body::Pelvis(1), table: Table::Plain, coarse },
        Patient { body: Body::Neck(1), table: Table::Shipped, coarse },
    ] {
        let problem = patient.problem().unwrap();
        let grid = stillpoint_plan::dose::DoseParams::over(problem.case().grid(), 8.0).grid;
        let whole = patient.objectives().unwrap().for_case(problem.case(), &grid).unwrap();
        for (structure, all) in problem.requested().iter().zip(&whole.structures) {
            assert_eq!(structure.name, all.name);
            let volume: f64 = structure.volumes.iter().sum();
            assert!((volume - all.voxels.len() as f64).abs() < 1e-6, "{}", structure.name);
            assert_eq!(structure.voxels.len(), structure.volumes.len());
        }
        assert!(problem.rows() < grid.len() / 10, "{}", problem.rows());
    }
}
