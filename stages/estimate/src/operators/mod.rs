//! The operators of this family, a file each.
//!
//! - `kalman`: `estimate.kalman`, a measured pose to a track
//! - `fuse`: `estimate.fuse`, two tracks to one
//! - `filter`: the filter of any number of channels, from sample to sample
//! - `fusion`: the fusion of any number of channels, from sample to sample
//! - `truths`: the true poses of the last frames, for NEES

mod filter;
mod fuse;
mod fusion;
mod kalman;
mod truths;

pub use fuse::{EstimateFuse, FuseParams, Method};
pub use kalman::{EstimateKalman, FilterParams};
