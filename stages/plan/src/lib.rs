//! The planner's ground: a patient goes in, a dose matrix, a fluence map and a plan come out.
//!
//! Lengths are in millimetres and their names say so (`_mm`): images, machine files and plans are written in them, and
//! grid positions stay exact. Doses are in gray, angles in degrees where a plan counts them (`_deg`), else in radians.
//!
//! - [`beams`]: which angles
//! - [`case`]: a patient, and the files it comes from and is kept in
//! - [`couch`]: from the couch's frame to the patient's
//! - [`dose`]: the dose that beams of photons give
//! - [`evaluation`]: what a dose does to each structure
//! - `grid`: where the voxels are
//! - [`fluence`]: the weights of the bixels that come nearest to what is wanted
//! - [`metrics`]: histograms and indices of a dose
//! - [`objectives`]: what is wanted of each structure, by a table of names and roles
//! - `sparse`: the dose-influence matrix
//! - `threads`: the same work on many items

#![forbid(unsafe_code)]

pub mod beams;
pub mod case;
pub mod couch;
pub mod dose;
pub mod evaluation;
pub mod fluence;
mod grid;
pub mod metrics;
pub mod objectives;
mod sparse;
mod threads;

pub use grid::Grid;
pub use sparse::{Csc, CscError, CscRef, Rows, RowsError, RowsRef, Setups};
