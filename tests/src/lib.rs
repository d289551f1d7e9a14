//! The kit: operators for whole-system tests. Small and quick, each with one habit that a pipeline must live with.
//!
//! - `counter`: sends numbers, and some of them wrong on purpose
//! - `mixer`: takes several inputs and sends what they add up to
//! - `fragile`: may not be made
//! - `lapping`: has its stages measured
//! - `post`: writes and reads datagrams
//! - `printing`: prints
//! - `wide`: has many outputs
//! - `bulk`: samples of any size, for loads

// Faults are what this crate is for.
#![allow(clippy::panic, clippy::print_stdout)]

mod bulk;
mod counter;
mod fragile;
mod lapping;
mod mixer;
mod post;
mod printing;
mod wide;

use stillpoint_operator::Stage;

/// The kit's kinds of operators.
pub const STAGES: &[Stage] = &[
    Stage::of::<counter::Counter>(),
    Stage::of::<counter::Outside>(),
    Stage::of::<mixer::Mixer>(),
    Stage::of::<mixer::Paired>(),
    Stage::of::<mixer::Echoing>(),
    Stage::of::<mixer::Splitting>(),
    Stage::of::<fragile::Fragile>(),
    Stage::of::<lapping::Lapping>(),
    Stage::of::<post::Reading>(),
    Stage::of::<post::Writing>(),
    Stage::of::<printing::Printing>(),
    Stage::of::<wide::Wide>(),
    Stage::of::<bulk::Bulk>(),
    Stage::of::<bulk::Drain>(),
];
