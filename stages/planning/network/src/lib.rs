//! A learned prior of beam angles: which gantry angles suit a patient, from the geometry alone. No dose is computed.
//!
//! The network sees each angle of a ring through the beam's eye: path lengths through tissue, which organs lie before,
//! behind and beside the target, and how much two beams overlap outside of it. It has two heads (SCIENCE G7): the value of a
//! set of beams, and the policy, that is which beam to add to those that are kept. This crate runs a trained network in plain
//! code; `stillpoint-train` trains it.
//!
//! - [`volume`]: density and structures of a case, and rays through them
//! - [`eye`]: the features; [`view`]: what they are seen in; [`lattice`]: the bixels
//! - [`groups`]: groups of features that a network can be trained without
//! - [`model`]: the network's numbers and its forward pass
//! - [`mod@file`]: the model file
//! - [`problem`]: a case with goals and coarse doses; [`patient`]: phantoms and case files of training
//! - [`game`]: sets that a network proposes and a search finds, solved: what self-play is made of
//! - [`learned`]: what a network says of a case that is planned
//! - [`judgement`]: what the network says of the sets of a case, and the sets of the best value

#![forbid(unsafe_code)]

pub mod eye;
pub mod file;
pub mod game;
pub mod groups;
pub mod judgement;
pub mod lattice;
pub mod learned;
pub mod model;
pub mod patient;
pub mod problem;
pub mod view;
pub mod volume;

pub use eye::{Eye, EyeError};
pub use file::ModelFileError;
pub use game::{Due, Game, GameError, Rules};
pub use groups::Group;
pub use judgement::Judgement;
pub use learned::{LearnedError, caution, with_network};
pub use model::{Model, Sizes};
pub use patient::{Patient, PatientError};
pub use problem::{Coarseness, Problem, ProblemError};
