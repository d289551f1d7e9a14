//! The kit: operators for whole-system tests. Small and quick, each with one habit that a pipeline must live with.
//!
//! - `counter`: sends numbers, and some of them wrong on purpose
//! - `mixer`: takes several inputs and sends what they add up to
//! - `fragile`: cannot be made
//! - `bulk`: samples of any size, for loads

// Faults are what this crate is for.
#![allow(clippy::panic)]

mod bulk;
mod counter;
mod fragile;
mod mixer;

use stillpoint_pipeline::Stage;

/// The kit's kinds of operators.
pub const STAGES: &[Stage] = &[
    Stage::of::<counter::Counter>(),
    Stage::of::<counter::Outside>(),
    Stage::of::<mixer::Mixer>(),
    Stage::of::<mixer::Paired>(),
    Stage::of::<mixer::Echoing>(),
    Stage::of::<mixer::Splitting>(),
    Stage::of::<fragile::Fragile>(),
    Stage::of::<bulk::Bulk>(),
    Stage::of::<bulk::Drain>(),
];
