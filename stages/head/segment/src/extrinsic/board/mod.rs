//! Where a camera is over the couch: a printed checkerboard of known place is found in its grey images.
//!
//! - `picture`: a grey image, smoothed and sampled
//! - `target`: the board, where it is, and its axes
//! - `saddle`: places where four squares may meet
//! - `lattice`: which of them are the corners of one board
//! - `refine`: a corner to a part of a pixel
//! - `pose`: the rigid transform from board to camera, its covariance, and the focal length that the corners have
//! - `place`: from images to the place of the camera and its error
//! - `error`: why there is none

mod error;
mod lattice;
mod picture;
mod place;
mod pose;
mod refine;
mod saddle;
mod target;

pub use error::BoardError;
pub use picture::Picture;
pub use place::{BoardLimits, BoardParts, BoardPlace, place_by_board};
pub use pose::Lens;
pub use target::Board;
