//! A patient, as the tracker and the planner share one: a planned patient is the patient that is seen and held.
//!
//! Lengths are in millimetres and their names say so (`_mm`): images and plans are written in them, and grid positions
//! stay exact.
//!
//! - [`case`]: images, structures and prescription, and the files that hold them
//! - [`couch`]: from the couch's frame to the patient's
//! - `grid`: where the voxels are
//! - [`outline`]: the surface of a patient, and files of surfaces
//! - [`ply`]: the reader of PLY files, of meshes and of point clouds
//! - [`records`]: numbers of text files, the end of records, quotes in errors

#![forbid(unsafe_code)]
// Outsiders use it.
#![warn(missing_docs)]

pub mod case;
pub mod couch;
mod grid;
pub mod outline;
pub mod ply;
pub mod records;

pub use grid::Grid;
