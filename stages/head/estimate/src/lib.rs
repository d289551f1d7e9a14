//! Estimates the state behind noisy measurements.
//!
//! - `state`: the state of a constant-velocity filter and its two equations.
//! - `manifold`: the space of the mean: channels that add, or a pose.
//! - `process`: the process noise.
//! - `measurement`: a measurement, and the channels that it does not measure.
//! - `kalman`: the filter, from stamp to stamp.
//! - [`consistency`]: NIS and NEES.
//! - [`fusion`], [`cross`]: fusion of two tracks of one motion, and the cross covariance of their errors.
//! - `watch`, [`offset`]: whether a sensor can be used, and the offset between two clocks.
//! - `channels`: the channels of a pose that are estimated, and their layout in samples.
//! - `operators`, `estimate.kalman` and `estimate.fuse`.

#![forbid(unsafe_code)]

mod channels;
pub mod consistency;
pub mod cross;
pub mod fusion;
mod kalman;
mod manifold;
mod measurement;
pub mod offset;
mod operators;
mod process;
mod state;
mod watch;

pub use kalman::{Counts, Kalman, KalmanParams, Outcome, ParamError, StampError};
pub use manifold::Manifold;
pub use measurement::Measurement;
pub use process::{Hold, ProcessNoise};
pub use state::{Innovation, State};

use stillpoint_operator::Stage;

/// The operators of this family.
pub const STAGES: &[Stage] =
    &[Stage::of::<operators::EstimateKalman>(), Stage::of::<operators::EstimateFuse>()];
