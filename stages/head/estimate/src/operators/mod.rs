//! The operators of this family, a file each.
//!
//! - `kalman`: `estimate.kalman`, a measured pose to a track
//! - `fuse`: `estimate.fuse`, two tracks to one
//! - `dispute`: which of two sensors that are apart is wrong
//! - `filter`: the filter of any number of channels, from sample to sample
//! - `fusion`: the fusion of any number of channels, from sample to sample
//! - `truths`: the true poses of the last frames, for NEES

mod dispute;
mod filter;
mod fuse;
mod fusion;
mod kalman;
mod truths;

pub use fuse::EstimateFuse;
pub use kalman::EstimateKalman;
