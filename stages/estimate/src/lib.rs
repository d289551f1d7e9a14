//! Estimates the state behind noisy measurements.
//!
//! - [`state`]: the state of a constant-velocity filter and its two equations.
//! - [`manifold`]: where its mean lives: channels that add, or a pose.
//! - [`process`]: how much the motion may change by itself.
//! - [`measurement`]: what is measured, and which channels are open.
//! - [`kalman`]: the filter, from stamp to stamp.
//! - [`consistency`]: NIS and NEES.
//! - [`fusion`], [`cross`]: two tracks of one motion as one, and what their errors have in common.
//! - [`watch`], [`offset`]: whether a sensor can be used, and how far two clocks are apart.
//! - [`channels`]: which channels of a pose are followed, and how they stand in samples.
//! - [`mod@operators`], `estimate.kalman` and `estimate.fuse`.

#![forbid(unsafe_code)]

pub mod channels;
pub mod consistency;
pub mod cross;
pub mod fusion;
pub mod kalman;
pub mod manifold;
pub mod measurement;
pub mod offset;
pub mod operators;
pub mod process;
pub mod state;
pub mod watch;

pub use kalman::{Counts, Kalman, KalmanParams, Outcome, ParamError, StampError};
pub use manifold::Manifold;
pub use measurement::Measurement;
pub use process::{Hold, ProcessNoise};
pub use state::{Innovation, State};

use stillpoint_operator::Stage;

/// The operators of this family.
pub const STAGES: &[Stage] =
    &[Stage::of::<operators::EstimateKalman>(), Stage::of::<operators::EstimateFuse>()];
