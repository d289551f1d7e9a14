//! A case made ready for plans: points, goals, dose engines.

use stillpoint_patient::case::{Case, CaseFileError, ContentHash, content_hash};
use thiserror::Error;

use super::spec::{PointScheme, RobustBy, SetupSpec};
use crate::beams::{Directions, RingError};
use crate::dose::{BeamAngles, BixelSpec, DoseEngine, DoseError, DoseParams, EngineName, MachineError};
use crate::fluence::Goals;
use crate::objectives::{ObjectiveSet, ObjectiveSetError, TableError};
use crate::protocol::Served;
use crate::sampling::Sampling;

/// A case made ready for plans with the parameters of a [`SetupSpec`].
pub struct PlanSetup {
    /// The patient.
    pub case: Case,
    /// Hash of the case.
    pub hash: ContentHash,
    /// The parameters.
    pub spec: SetupSpec,
    /// Where the beams may come from.
    pub directions: Directions,
    /// The points whose dose is optimised.
    pub sampling: Sampling,
    /// The objectives of each structure in gray, on the points that count for it.
    pub objective_set: ObjectiveSet,
    /// Which objective serves each limit of the protocol.
    pub served: Vec<Served>,
    /// The same as plans are solved for: over all set-ups, or in the robust game for the planned set-up.
    pub goals: Goals,
    /// The goals of the robust game in two parts: of what moves with the patient, and of what counts as planned.
    pub(super) parts: Option<[Goals; 2]>,
    /// The dose engines of the points in each set-up, the planned one first.
    engines: Vec<DoseEngine>,
}

/// The reasons why a case cannot be planned.
#[derive(Debug, Error)]
pub enum SetupError {
    /// The case has no hash.
    #[error(transparent)]
    Case(#[from] Box<CaseFileError>),
    /// The table of objectives is damaged.
    #[error(transparent)]
    Table(#[from] TableError),
    /// The machine file is damaged.
    #[error(transparent)]
    Machine(#[from] MachineError),
    /// The ring has no angle.
    #[error(transparent)]
    Ring(#[from] RingError),
    /// The objectives do not fit the case.
    #[error(transparent)]
    Objectives(#[from] ObjectiveSetError),
    /// No dose can be computed.
    #[error(transparent)]
    Dose(#[from] DoseError),
    /// The robust game has no second player.
    #[error(
        "the robust game of the worst set-up needs set-up errors: give at least one displacement of the patient"
    )]
    NoErrors,
    /// A set-up error is out of range.
    #[error("invalid shift of the patient: {shift_mm} mm (allowed: above 0 mm and at most {most_mm} mm)")]
    Shift {
        /// The shift, mm.
        shift_mm: f64,
        /// The largest, mm.
        most_mm: f64,
    },
}

impl PlanSetup {
    /// Makes a case ready. No dose of a beam is computed.
    ///
    /// # Errors
    /// The objectives do not fit the case, a parameter is out of range, or the case has no outline or no target.
    pub fn new(case: Case, spec: SetupSpec) -> Result<Self, SetupError> {
        if spec.robust_by == RobustBy::Worst && spec.errors_mm.is_empty() {
            return Err(SetupError::NoErrors);
        }
        let hash = content_hash(&case).map_err(Box::new)?;
        let sampling = match spec.points {
            PointScheme::Borders => Sampling::new(&case, spec.grid_mm, spec.bixel_mm)?,
            PointScheme::Sparse => Sampling::sparse(&case, spec.grid_mm, spec.bixel_mm)?,
            PointScheme::EveryVoxel => Sampling::every_voxel_of(&case, spec.grid_mm)?,
            PointScheme::Thinned => Sampling::thinned(&case, spec.grid_mm)?,
        };
        let mut objective_set = spec.objectives.for_points(&case, &sampling)?;
        let served = match &spec.protocol {
            Some(protocol) => protocol.serve(&case, &mut objective_set.structures),
            None => Vec::new(),
        };
        let is_game = spec.robust_by == RobustBy::Worst;
        let goals = objective_set.goals(if is_game { 1 } else { 1 + spec.errors_mm.len() })?;
        let parts = is_game.then(|| objective_set.parts()).transpose()?;
        let of_search = spec.engine.of_search();
        let directions = spec.directions();
        let setup = Self {
            case,
            hash,
            spec,
            directions,
            sampling,
            objective_set,
            served,
            goals,
            parts,
            engines: Vec::new(),
        };
        setup.by(of_search)
    }

    /// The same for beams of these angles alone.
    ///
    /// # Errors
    /// An angle is not finite, or two beams have the same angles.
    pub fn for_angles(self, angles: &[BeamAngles]) -> Result<Self, RingError> {
        let spec = self.spec.for_angles(angles)?;
        Ok(Self { directions: spec.directions(), spec, ..self })
    }

    /// The same with doses by another method.
    ///
    /// # Errors
    /// The machine has no kernels, or no dose can be computed.
    pub fn by(self, engine: EngineName) -> Result<Self, SetupError> {
        let spec = &self.spec;
        let usual = BixelSpec::of_width(spec.bixel_mm);
        let bixels =
            BixelSpec { margin_mm: usual.margin_mm + spec.reach_mm, inside_mm: spec.inside_mm, ..usual };
        let over = DoseParams::over(self.case.grid(), spec.grid_mm);
        let params = DoseParams { grid: *self.sampling.grid(), bixels, engine, ..over };
        let planned = DoseEngine::of_case(&self.case, spec.machine.clone(), params)?;
        let planned = self.sampling.engine(&planned);
        let mut engines = Vec::with_capacity(1 + spec.errors_mm.len());
        if !spec.errors_mm.is_empty() {
            let moving = planned.within(self.objective_set.followed());
            for shift_mm in &spec.errors_mm {
                engines.push(moving.shifted(*shift_mm)?);
            }
        }
        engines.insert(0, planned);
        Ok(Self { engines, ..self })
    }

    /// The engine of the points in the planned set-up.
    pub fn engine(&self) -> &DoseEngine {
        &self.engines[0]
    }

    /// The engines of the points in each set-up, the planned one first.
    pub fn engines(&self) -> &[DoseEngine] {
        &self.engines
    }

    /// The displacement of the patient in each set-up, mm, the planned one first.
    pub fn setups_mm(&self) -> Vec<[f64; 3]> {
        [&[[0.0; 3]], &self.spec.errors_mm[..]].concat()
    }

    /// Number of set-ups for which a fluence is solved; the others belong to the second player of the robust game.
    pub fn solved_setups(&self) -> usize {
        if self.parts.is_some() { 1 } else { self.engines.len() }
    }

    /// Spacing of the points where they are closest, mm.
    pub fn points_mm(&self) -> f64 {
        self.sampling.grid().spacing_mm[0]
    }

    /// Highest prescribed dose, gray; 0 without a prescription.
    pub fn prescribed_gy(&self) -> f64 {
        self.case.prescription().iter().map(|p| p.dose_gy).fold(0.0, f64::max)
    }

    /// Angles of these beams.
    pub fn angles(&self, beams: &[u16]) -> Vec<BeamAngles> {
        self.directions.all(beams)
    }

    /// Gantry angles of these beams, degrees.
    pub fn angles_deg(&self, beams: &[u16]) -> Vec<f64> {
        self.directions.all(beams).iter().map(|angles| angles.gantry_deg).collect()
    }
}
