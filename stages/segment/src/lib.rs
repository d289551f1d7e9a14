//! Finds the face above a supporting plane in a point cloud.
//!
//! Clouds are slices of `[f32; 3]` in metres; a point with a coordinate that is not finite is no point.
//! Every result is a function of the cloud, the parameters and the random numbers handed in: sums run in the
//! order of the points, and no map's order reaches a result.
//!
//! - [`voxel`]: centroids of a grid's cells, and which point fell into which.
//! - [`plane`]: a plane and its least-squares fit.
//! - [`mlesac`]: the plane that most points lie on, by seeded MLESAC.
//! - [`hull`]: the convex outline of points on a plane.
//! - [`cluster`]: Euclidean clusters.
//! - [`face`]: the chain of these, from cloud to face.
//! - [`mod@operator`], `segment.face`, the chain as an operator.
//! - [`findings`]: what that operator says about a frame.

mod cells;
pub mod cluster;
pub mod face;
pub mod findings;
pub mod hull;
pub mod mlesac;
pub mod operator;
pub mod plane;
pub mod voxel;

pub use face::{Face, FaceParams, FaceSegmenter, Rejection};
pub use plane::Plane;

use stillpoint_pipeline::Stage;

/// The operators of this family.
pub const STAGES: &[Stage] = &[Stage::of::<operator::SegmentFace>()];
