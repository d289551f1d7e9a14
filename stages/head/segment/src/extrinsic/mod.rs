//! Where a camera is over the couch: three or more balls of known size and place, a printed board, or the couch's edges are
//! found in its images.
//!
//! - [`mod@board`]: a checkerboard in grey images
//! - [`mod@edges`]: the bare couch by its plane and edges
//! - `still`: the median of the images of a scene that stands still
//! - `targets`: balls on the couch, and whether they determine a place
//! - `balls`: balls of a known radius in a still image
//! - `place`: which ball is which, and the rigid transform from camera to couch
//! - `residual`: the error of the place that a pipeline file states
//! - `surface`: the bare couch beneath the balls, as a check
//! - `scale`: a flat plate at two distances: unit of the depth, and how flat it is measured

mod balls;
pub mod board;
pub mod edges;
mod error;
mod place;
mod residual;
mod scale;
mod still;
mod surface;
mod targets;

pub use balls::FoundBall;
pub use error::ExtrinsicError;
pub use place::{Limits, Placed, at_and_rotation, place};
pub use residual::Parts;
pub use scale::{DepthScale, depth_scale};
pub use still::{Still, StillImages};
pub use surface::SurfaceCheck;
pub use targets::{Ball, Targets};
