//! The parameters of a set-up.

use serde::{Deserialize, Serialize};

use super::engine::PlanEngine;
use super::setup::SetupError;
use crate::beams::{Directions, Ring, RingError};
use crate::dose::{BeamAngles, Machine};
use crate::objectives::ObjectiveTable;
use crate::protocol::Protocol;

/// Angles of the ring, 4 degrees apart, and the steps that beams keep from each other: 20 degrees.
const RING: (u16, u16) = (90, 5);
/// Angles between beams of a plan, at least, as a part of the circle: 20 degrees.
const PARTS_OF_CIRCLE: u16 = 18;
/// Largest set-up error along an axis, mm.
const LARGEST_MM: f64 = 50.0;

/// All that a plan depends on beside the case and the choice of beams.
#[derive(Clone, Debug)]
pub struct SetupSpec {
    /// The objectives.
    pub objectives: ObjectiveTable,
    /// Limits that the objectives aim at, too: those that no objective serves get one.
    pub protocol: Option<Protocol>,
    /// The machine.
    pub machine: Machine,
    /// The rule for the method by which dose is computed.
    pub engine: PlanEngine,
    /// Spacing of the points whose dose is optimised, mm.
    pub grid_mm: f64,
    /// Width of a bixel, mm.
    pub bixel_mm: f64,
    /// How much farther beyond the target than usual bixels are placed, mm, so that a plan can follow a shift.
    pub reach_mm: f64,
    /// Which voxels are points.
    pub points: PointScheme,
    /// Displacements of the patient beside the planned set-up, along his axes, mm.
    pub errors_mm: Vec<[f64; 3]>,
    /// What is optimised where there are displacements.
    pub robust_by: RobustBy,
    /// The gantry angles that beams may have.
    pub ring: Ring,
    /// Where beams may come from instead, if there are couch angles among them.
    pub listed: Option<Directions>,
    /// How far within the edge of the patient the rays of bixels run at least, mm; negative: how far beside it they may run.
    pub inside_mm: f64,
}

/// Which voxels of the dose grid are points, whose dose is optimised.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PointScheme {
    /// Points of half the spacing at the borders of targets, fewer far from them: those of plans.
    #[default]
    Borders,
    /// Half of these in and around targets and in organs, and fewer elsewhere: those of the search for the leaves of arcs.
    Sparse,
    /// Every voxel of the grid.
    EveryVoxel,
    /// Voxels of targets, every second of organs and near targets, one in eighteen elsewhere: those of training.
    Thinned,
}

/// What is optimised where there are several set-ups.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RobustBy {
    /// The mean over the set-ups, by beams and by fluence.
    #[default]
    Mean,
    /// The worst set-up, by beams: the robust game. The fluence is that for the planned set-up.
    Worst,
}

impl SetupSpec {
    /// What plans have where nothing else is said: the objectives and the machine that come with stillpoint, points 5 mm
    /// apart, bixels of 10 mm, one set-up, and 90 angles of which beams are at least 20 degrees apart.
    ///
    /// # Errors
    /// A file that comes with stillpoint is damaged.
    pub fn shipped() -> Result<Self, SetupError> {
        let (count, gap) = RING;
        Ok(Self {
            objectives: ObjectiveTable::shipped()?,
            protocol: None,
            machine: Machine::shipped()?,
            engine: PlanEngine::Auto,
            grid_mm: 5.0,
            bixel_mm: 10.0,
            reach_mm: 0.0,
            points: PointScheme::Borders,
            errors_mm: Vec::new(),
            robust_by: RobustBy::Mean,
            ring: Ring::new(count, gap)?,
            listed: None,
            inside_mm: 0.0,
        })
    }

    /// Where beams may come from.
    pub fn directions(&self) -> Directions {
        self.listed.clone().unwrap_or_else(|| self.ring.into())
    }

    /// The same for beams of these angles alone, on a ring where that holds them.
    ///
    /// # Errors
    /// An angle is not finite, or two beams have the same angles.
    pub fn for_angles(self, angles: &[BeamAngles]) -> Result<Self, RingError> {
        let directions = Directions::for_angles(self.ring, angles)?;
        let is_ring = directions.step_deg().is_some();
        let ring = if is_ring { directions.ring() } else { self.ring };
        Ok(Self { ring, listed: (!is_ring).then_some(directions), ..self })
    }

    /// A ring of so many angles, of which beams are at least 20 degrees apart.
    ///
    /// # Errors
    /// There is no angle.
    pub fn ring_of(angles: u16) -> Result<Ring, RingError> {
        Ring::new(angles, angles.div_ceil(PARTS_OF_CIRCLE))
    }
}

/// The displacements of a robust plan: by this length along each axis, both ways.
///
/// # Errors
/// The length is not above 0 mm and at most 50 mm.
pub fn set_up_errors(shift_mm: f64) -> Result<Vec<[f64; 3]>, SetupError> {
    if !(shift_mm > 0.0 && shift_mm <= LARGEST_MM) {
        return Err(SetupError::Shift { shift_mm, most_mm: LARGEST_MM });
    }
    let mut errors = Vec::new();
    for axis in 0..3 {
        for shift in [-shift_mm, shift_mm] {
            let mut moved = [0.0; 3];
            moved[axis] = shift;
            errors.push(moved);
        }
    }
    Ok(errors)
}
