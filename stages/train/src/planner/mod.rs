//! Trains the prior of beam angles of `stillpoint-network`.
//!
//! - `problem`: a varied pelvis with goals and coarse doses
//! - `gather`: sets of beams with their costs, found by search, kept in a folder
//! - `examples`: a case as the training takes it
//! - `loss`: (5.9), SCIENCE G7
//! - `network`: the network as tensors, with gradients
//! - `adam`: the optimiser, whose whole state is kept
//! - `fit`: epochs, validation, checkpoints
//! - `checkpoint`: the file from which a training resumes
//! - `strength`: what the sets of a model cost beside the sets of habit
//! - `card`: the model card

mod adam;
mod card;
mod checkpoint;
mod examples;
mod fit;
mod gather;
mod loss;
mod network;
mod problem;
mod strength;

pub use adam::Adam;
pub use card::{About, Card};
pub use checkpoint::Checkpoint;
pub use examples::{Example, examples};
pub use fit::{Epoch, Fitted, Options, fit};
pub use gather::{Gather, SolvedCase, gather};
pub use loss::{Weights, loss};
pub use network::Network;
pub use problem::{Coarseness, Problem};
pub use strength::{Strength, Summary, strength};
