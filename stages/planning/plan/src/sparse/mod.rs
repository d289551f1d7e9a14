//! The dose-influence matrix: dose to each voxel per unit weight of each bixel.
//!
//! - `columns`: bixel by bixel, as pencil beams are computed
//! - `rows`: voxel by voxel, as superposition is computed, and as all are kept and solved
//! - `setups`: a beam's matrices for several set-ups of the patient, one above the other

mod columns;
mod rows;
mod setups;

pub use columns::{Csc, CscError, CscRef};
pub(crate) use rows::RowsBuilder;
pub use rows::{Rows, RowsError, RowsRef};
pub use setups::{ByRows, Setups};
