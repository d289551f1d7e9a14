//! Follows what a stage before has cut out of a cloud.
//!
//! - [`mod@centroid`]: the mean of a cloud and how well it is known.
//! - [`mod@operator`], `track.centroid`.

pub mod centroid;
pub mod operator;

pub use centroid::{Centroid, centroid};

use stillpoint_pipeline::Stage;

/// The operators of this family.
pub const STAGES: &[Stage] = &[Stage::of::<operator::TrackCentroid>()];
