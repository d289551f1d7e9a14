//! - `allocation`: steps that take nothing from the heap
//! - `fuse_operator`: `estimate.fuse` on a bench, with sensors that fail
//! - `fusion`: two tracks as one, against the centralised filter
//! - `kalman`: stamps, gaps, outliers, open channels
//! - `pose`: the filter of a pose
//! - `vectors`: the filter against the vectors of SCIENCE D
//! - `kalman_operator`: `estimate.kalman` on a bench

mod allocation;
mod fuse_operator;
mod fusion;
mod kalman;
mod kalman_operator;
mod pose;
mod vectors;
