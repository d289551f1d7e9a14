//! Estimates the state behind noisy measurements.
//!
//! - [`kalman`]: the constant-velocity filter, from stamp to stamp.
//! - [`state`]: the state of such a filter and its two equations.
//! - [`mod@operator`], `estimate.kalman`.

pub mod kalman;
pub mod operator;
pub mod state;

pub use kalman::{Counts, Kalman, KalmanParams, Measurement, Outcome, ParamError, StampError};
pub use state::{Innovation, State};

use stillpoint_pipeline::Stage;

/// The operators of this family.
pub const STAGES: &[Stage] = &[Stage::of::<operator::EstimateKalman>()];
