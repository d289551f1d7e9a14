//! Brings a cloud onto a reference surface: iterated weighted least squares of the distances to its patches.
//!
//! Each step finds every point's partner (point to quadric, so neither spacing nor curvature biases the distance), leaves
//! out points over the surface's edge and such as are seen at a grazing angle, weights the rest robustly with
//! a scale from the median distance, and solves for the movement in the directions that the surface constrains.
//!
//! - `aligner`: the iterations, and what is known of where they end.
//! - `robust`: how distances are weighted.
//! - `equations`: the normal equations.
//! - `parts`: how parts of the surface agree.
//! - `pieces`: whether each piece of the surface moves with the rest.
//! - `together`: whether a piece was seen to move as the rest does.
//! - `mimic`: whether the movable part of a face is where it was.
//! - `mixture`: whether all its patches were seen to move alike.
//! - `misfit`: how far a cloud is from the surface.

mod aligner;
mod equations;
mod mimic;
mod misfit;
mod mixture;
mod parts;
mod pieces;
mod robust;
mod together;

pub use aligner::{AlignParams, Aligner, Alignment, Approach, Effort};
pub use misfit::misfit;
pub use parts::{Agreement, PartAxes, agreement};
pub use pieces::{Known, Pieces};
pub use robust::Robust;
pub use together::Verdict;
