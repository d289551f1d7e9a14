//! Estimates the state behind noisy measurements.
//!
//! - [`kalman`]: the constant-velocity filter, from stamp to stamp.
//! - [`state`]: the state of such a filter and its two equations.

pub mod kalman;
pub mod state;

pub use kalman::{Counts, Kalman, KalmanParams, Measurement, Outcome, ParamError, StampError};
pub use state::{Innovation, State};
