//! The network that comes with the project: its card is that of its file, and it chooses better than no knowledge does.

#![allow(clippy::unwrap_used)]

use std::num::NonZeroUsize;

use stillpoint_network::game::play;
use stillpoint_network::patient::{Body, Table};
use stillpoint_network::{Coarseness, Model, Patient, Rules};

#[test]
fn the_card_is_that_of_the_file() {
    let card = include_str!("../data/planner.md");
    assert!(card.contains(&Model::shipped().unwrap().hash().unwrap()));
}

#[test]
fn its_first_set_costs_less_than_a_rotation_of_equal_beams() {
    let rules = Rules { beams: 5, class: false, rotations: 4, proposed: 1, search: 0, random: 0 };
    // None of these was trained on.
    for seed in [3, 4, 5] {
        let patient = Patient { body: Body::Pelvis(seed), table: Table::Plain, coarse: Coarseness::USUAL };
        let game = play(Some(&Model::shipped().unwrap()), &patient, 1, rules, NonZeroUsize::MIN).unwrap();
        let mean = game.rotations.iter().sum::<f64>() / game.rotations.len() as f64;
        assert!(
            game.proposed[0] < 0.95 * mean,
            "pelvis {seed}: {:?} beside {:?}",
            game.proposed,
            game.rotations
        );
    }
}
