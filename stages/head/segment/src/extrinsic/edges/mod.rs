//! Where a camera is over the couch: the plane of its bare top and three of its edges are found in depth images.
//!
//! - `plane`: the plane of the couch's top
//! - `cracks`: places between a pixel on the plane and one beyond its edge
//! - `sides`: two long edges at the couch's width, and the edge at its head end
//! - `place`: from these to the place of the camera and its error
//! - `error`: why there is none

mod cracks;
mod error;
mod place;
mod plane;
mod sides;

pub use error::EdgeError;
pub use place::{Couch, EdgeParts, EdgePlace, place_by_edges};
