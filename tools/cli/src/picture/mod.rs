//! Pictures of a case: its slices with structures, doses and beams over them.
//!
//! - `canvas`: pixels, lines, letters, PNG
//! - `letters`: the letters and digits that stand in pictures
//! - `slice`: a slice of the image with the outlines of structures
//! - `wash`: a dose and beams over a slice

mod canvas;
mod letters;
mod slice;
mod wash;

pub use slice::{COLOURS, Plane, draw};
pub use wash::{Wash, wash};
