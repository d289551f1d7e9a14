//! Plans: a patient (`stillpoint-patient`) goes in, a dose matrix, a fluence map and a plan come out.
//!
//! Lengths are in millimetres and their names say so (`_mm`): images, machine files and plans are written in them, and
//! grid positions stay exact. Doses are in gray, angles in degrees where a plan counts them (`_deg`), else in radians.
//!
//! - [`arc`]: beams that are on while the gantry turns
//! - [`beams`]: which angles
//! - [`check`]: what a person should look at in a plan
//! - [`dose`]: the dose that beams of photons give
//! - [`delivery`]: the dose that a moving patient got
//! - [`distance`]: how far voxels are from a set of voxels
//! - [`evaluation`]: what a dose does to each structure
//! - [`fluence`]: the weights of the bixels that come nearest to what is wanted
//! - [`gamma`]: how far two doses are from each other
//! - [`leaves`]: the fluence as segments of a multileaf collimator
//! - [`measured`]: doses measured in a water tank, and the machine that is fitted to them
//! - [`metrics`]: histograms and indices of a dose
//! - [`monte_carlo`]: the dose of a machine next to that of a Monte Carlo program
//! - [`occupancy`]: how much of each voxel a structure takes
//! - [`objectives`]: what is wanted of each structure, by a table of names and roles
//! - [`plan_file`]: `plan.json`, written and read back
//! - [`protocol`]: limits of doses, and a plan beside them
//! - [`recipe`]: the one recipe of a plan: set-up, request, search
//! - [`recompute`]: the dose of a plan on a grid of its own, of which its figures are
//! - [`sampling`]: the points whose dose is optimised
//! - `sparse`: the dose-influence matrix
//! - [`threads`]: the same work on many items

#![forbid(unsafe_code)]
// Outsiders use it.
#![warn(missing_docs)]

pub mod arc;
pub mod beams;
pub mod check;
pub mod delivery;
pub mod distance;
pub mod dose;
pub mod evaluation;
pub mod fluence;
pub mod gamma;
pub mod leaves;
pub mod measured;
pub mod metrics;
pub mod monte_carlo;
pub mod objectives;
pub mod occupancy;
pub mod plan_file;
pub mod protocol;
pub mod recipe;
pub mod recompute;
pub mod sampling;
mod sparse;
pub mod threads;

pub use sparse::{ByRows, Csc, CscError, CscRef, Rows, RowsError, RowsRef, Setups};
