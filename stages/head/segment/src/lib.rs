//! Finds the face above a supporting plane in a point cloud.
//!
//! Clouds are slices of `[f32; 3]` in metres; a point with a coordinate that is not finite is no point.
//! Every result is a function of the cloud, the parameters and the random numbers handed in: sums run in the
//! order of the points, and no map's order reaches a result.
//!
//! - `cloud`: a cloud as a camera gives it.
//! - [`voxel`]: centroids of a grid's cells, and which point fell into which.
//! - `neighbours`: the k nearest neighbours of each point.
//! - [`outliers`]: statistical outlier removal.
//! - [`mls`]: robust moving least squares.
//! - `plane`: a plane and its least-squares fit.
//! - [`mlesac`]: the plane that most points lie on, by seeded MLESAC.
//! - [`hull`]: the convex outline of points on a plane.
//! - [`cluster`]: Euclidean clusters.
//! - `surface`: patches of the surface that voxels lie on, with normals and creases.
//! - `ball`: where a ball of about a head's size is.
//! - `summit`: summits of a landscape.
//! - `cut`: minimum cut of a graph.
//! - `head`: the head, cut from what it touches; `hills`, other things beside it; `neck`, which way its neck lies.
//! - [`identity`]: which of the balls is the head.
//! - [`extrinsic`]: where a camera is over the couch, by balls of known size and place.
//! - [`table`]: the table of the clusters.
//! - `face`: the chain of these, from cloud to face.
//! - `operator`, `segment.face`, the chain as an operator.
//! - `findings`: what that operator says about a frame.

mod ball;
mod cell_index;
mod cells;
mod cloud;
pub mod cluster;
mod cut;
pub mod extrinsic;
mod face;
mod findings;
mod forest;
mod head;
mod hills;
pub mod hull;
pub mod identity;
pub mod mlesac;
pub mod mls;
mod neck;
mod neighbours;
mod operator;
pub mod outliers;
mod plane;
mod summit;
mod surface;
mod sweep;
pub mod table;
pub mod voxel;

pub use cloud::Cloud;
pub use face::{Advice, FaceParams, FaceSegmenter, Rejection, Rule, Seen, SegmentationStep};
pub use plane::Plane;

use stillpoint_operator::Stage;

/// The operators of this family.
pub const STAGES: &[Stage] = &[Stage::of::<operator::SegmentFace>()];
