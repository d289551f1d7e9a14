//! Training of the prior of beam angles that `stillpoint-network` runs.
//!
//! 1. Games ([`stillpoint_network::game`]) solve sets of beams for phantoms. Openings are found by exchange and at random; in
//!    later rounds the network proposes sets and guides a tree search.
//! 2. Of each patient the features of the beam's eye and the solved sets become an example.
//! 3. Passes over a bounded buffer of games train the network by the loss (5.9) of SCIENCE G7, while players play the games
//!    of the round with the weights of the round before (ch. 5.3.1).
//! 4. Examinations solve the network's own sets for patients outside of training.
//!
//! A round is so many games and so many passes, never a time, and a game is a pure function of the weights, the patient and
//! the seed. So a training gives the same bytes with any number of players, and resumes to the bit.
//!
//! - `selfplay`: openings, rounds, examinations
//! - `players`: where games are played: in this process, or kept in a folder and played elsewhere; `pooled`: on a pool
//! - `features`: the features of patients, kept; `examples`: what is trained on
//! - `network`: the network as tensors
//! - `loss`, `adam`, `training`, `checkpoint`: the descent
//! - `exam`: strength; `card`: what a model was trained on

mod adam;
mod card;
mod checkpoint;
mod exam;
mod examples;
mod features;
mod loss;
mod network;
mod players;
mod pooled;
mod selfplay;
mod training;

pub use adam::Adam;
pub use card::{About, Card};
pub use checkpoint::Checkpoint;
pub use exam::{Exam, Summary};
pub use examples::{Example, States, scales};
pub use features::Features;
pub use loss::{Weights, loss};
pub use network::{Loaded, Network};
pub use players::{Done, Here, Players, Stored, not_played};
pub use pooled::Pooled;
pub use selfplay::{Progress, Report, Schedule, Trained, train};
pub use training::{Options, Pass, Ready, Training};

/// An error of planning.
pub(crate) fn plan(error: impl std::fmt::Display) -> crate::TrainError {
    crate::TrainError::Plan(error.to_string())
}
