//! Arcs: the gantry turns while the beam is on, and the leaves move.
//!
//! What is optimised is what is delivered: between two control points the tips move evenly with the gantry, and a constant number of
//! monitor units is given for each degree of an interval (DICOM PS3.3 C.8.8.14). So the variables are the tips at control points and the weights of
//! *intervals*, and the dose of an interval is that of its tips at the midpoints of its halves.
//!
//! - `spec`: which way an arc goes
//! - `field`: control points, and the doses of all that leaves can open
//! - `window`: where tips may be; `trajectory`: tips and weights, with the limits that they keep
//! - `start`: apertures by price; `sweep`: the leaves; `weights`: the weights of intervals
//! - `optimise`: all of it
//! - `beam`: the leaves of an arc as they are exported; `dose`: the dose that is reported, of angles that are closer to each other

mod beam;
mod dose;
mod field;
mod optimise;
mod spec;
mod start;
mod sweep;
mod trajectory;
mod weights;
mod window;

use thiserror::Error;

use crate::RowsError;
use crate::dose::DoseError;
use crate::fluence::{GoalsError, ProblemError};

pub use crate::dose::{ArcLimits, Stretch};
pub use beam::{ArcBeam, ArcPoint};
pub use dose::{ArcDose, REPORTED_BIXELS, REPORTED_DEG, SpacingError};
pub use field::{ArcField, CellDoses, ControlAngle, Interval, LeafRow};
pub use optimise::{ArcOptions, Optimised, optimise};
pub use spec::{ArcSpec, ArcSpecError};
pub use sweep::{Tip, add_move, slope};
pub use trajectory::{Bounds, Trajectory};

/// The reasons why there is no arc.
#[derive(Debug, Error)]
pub enum ArcError {
    /// A dose cannot be computed.
    #[error(transparent)]
    Dose(#[from] DoseError),
    /// The goals make no problem.
    #[error(transparent)]
    Goals(#[from] GoalsError),
    /// The goals make no problem.
    #[error(transparent)]
    Problem(#[from] ProblemError),
    /// Doses make no matrix.
    #[error("the doses of the intervals of an arc: {0}")]
    Rows(#[from] RowsError),
    /// The target is beyond the leaves.
    #[error(
        "the target needs a field from {low_mm} to {high_mm} mm along the axis of the gantry, but the leaves shape {first_mm} to \
         {last_mm} mm; plan with another isocentre or another machine"
    )]
    Beyond {
        /// Lower edge of the field, mm.
        low_mm: f64,
        /// Upper edge of the field, mm.
        high_mm: f64,
        /// Lowest edge of the leaves, mm.
        first_mm: f64,
        /// Highest edge of the leaves, mm.
        last_mm: f64,
    },
    /// What is lit is beyond the tips of the leaves.
    #[error(
        "the target needs a field from {low_mm} to {high_mm} mm across the axis of the gantry, but leaves are withdrawn to {reach_mm} mm \
         and go over the axis by {over_travel_mm} mm; plan with another isocentre or another machine"
    )]
    Aside {
        /// Lower edge of the field, mm.
        low_mm: f64,
        /// Upper edge of the field, mm.
        high_mm: f64,
        /// Reach of the leaves, mm.
        reach_mm: f64,
        /// Their over-travel, mm.
        over_travel_mm: f64,
    },
    /// No ray to the target crosses the patient.
    #[error("an arc has no bixel: no ray to the target crosses the patient; check the outline")]
    Dark,
    /// Nothing lessens the objective.
    #[error("no aperture of an arc lessens the objective; check the objectives of the targets")]
    NoGain,
    /// An arc gives nothing beside the others.
    #[error("the arc {0} gives nothing that lessens the objective: leave it out")]
    Idle(ArcSpec),
    /// A limit of the machine does not hold.
    #[error("an arc breaks a limit of the machine: {0}; report this with the case")]
    Limit(String),
}
