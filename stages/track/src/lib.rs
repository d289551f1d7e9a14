//! Follows what a stage before has cut out of a cloud.
//!
//! - [`mod@centroid`]: the mean of a cloud and how well it is known.

pub mod centroid;

pub use centroid::{Centroid, centroid};
