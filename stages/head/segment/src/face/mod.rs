//! From a cloud to the face: voxels, the supporting plane, the objects on it, and which of them is the face.
//!
//! - `params`: what the chain needs to know.
//! - `seen`: what it found in a frame, or why not.
//! - `segmenter`: the chain.
//! - `support`: the plane that the head lies on.
//! - `pairs`: which patches are seen beside each other.

mod pairs;
mod params;
mod seen;
mod segmenter;
mod support;

pub use params::{FaceParams, Rule};
pub use seen::{Advice, Rejection, Seen, SegmentationStep};
pub use segmenter::FaceSegmenter;
