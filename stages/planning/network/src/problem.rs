//! A case with goals and coarse doses, on which sets of beams are solved fast.

use std::num::NonZeroUsize;

use serde::{Deserialize, Serialize};
use stillpoint_patient::case::Case;
use stillpoint_plan::Rows;
use stillpoint_plan::beams::Ring;
use stillpoint_plan::dose::{BeamInfluence, DoseEngine, DoseError, Machine};
use stillpoint_plan::fluence::{Goals, StructureObjectives};
use stillpoint_plan::objectives::{ObjectiveSetError, ObjectiveTable};
use stillpoint_plan::recipe::{PlanSetup, PointScheme, SetupError, SetupSpec};
use thiserror::Error;

/// How coarse doses are.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Coarseness {
    /// Spacing of the dose grid, mm.
    pub grid_mm: f64,
    /// Width of a bixel, mm.
    pub bixel_mm: f64,
}

/// What is solved: a set-up with the points of training.
pub struct Problem {
    setup: PlanSetup,
}

/// Why there is nothing to solve.
#[derive(Debug, Error)]
pub enum ProblemError {
    /// The case cannot be planned.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// The objectives do not fit the case.
    #[error(transparent)]
    ObjectiveSet(#[from] ObjectiveSetError),
    /// There is no dose.
    #[error(transparent)]
    Dose(#[from] DoseError),
    /// The dose matrices are too large.
    #[error("the doses are too large to be solved: {0}")]
    Rows(String),
}

impl Coarseness {
    /// The doses of comparisons: points at half the width of a bixel, so that all bixels are sampled alike.
    pub const USUAL: Self = Self { grid_mm: 5.0, bixel_mm: 10.0 };
}

impl Problem {
    /// A case with the objectives of a table. All points of targets count, every second of organs, and fewer of the outline,
    /// where each stands for the volume around it.
    pub fn new(
        case: Case,
        table: &ObjectiveTable,
        machine: Machine,
        coarse: Coarseness,
    ) -> Result<Self, ProblemError> {
        let spec = SetupSpec {
            objectives: table.clone(),
            machine,
            grid_mm: coarse.grid_mm,
            bixel_mm: coarse.bixel_mm,
            points: PointScheme::Thinned,
            ..SetupSpec::shipped()?
        };
        Ok(Self { setup: PlanSetup::new(case, spec)? })
    }

    /// The patient.
    pub fn case(&self) -> &Case {
        &self.setup.case
    }

    /// The objectives, structure by structure; voxels are rows of the doses.
    pub fn requested(&self) -> &[StructureObjectives] {
        &self.setup.objective_set.structures
    }

    /// The same, checked.
    pub fn goals(&self) -> &Goals {
        &self.setup.goals
    }

    /// The dose matrices of all beams of a ring.
    pub fn doses(&self, ring: Ring, threads: NonZeroUsize) -> Result<Vec<Rows>, ProblemError> {
        of_ring(self.setup.engine(), ring, threads)
    }

    /// The same to the patient moved by so much along his axes (mm), to the rows of what moves through the beams; 0 elsewhere.
    pub fn displaced(
        &self,
        ring: Ring,
        shift_mm: [f64; 3],
        threads: NonZeroUsize,
    ) -> Result<Vec<Rows>, ProblemError> {
        let [moving, _] = self.parts()?;
        let engine = self.setup.engine().within(moving.voxels()).shifted(shift_mm)?;
        of_ring(&engine, ring, threads)
    }

    /// The goals in two parts: of what moves through the beams with the patient, and of the outline, which counts as planned.
    pub fn parts(&self) -> Result<[Goals; 2], ObjectiveSetError> {
        self.setup.objective_set.parts()
    }

    /// Rows of the dose matrices.
    pub fn rows(&self) -> usize {
        self.setup.engine().rows()
    }
}

fn of_ring(engine: &DoseEngine, ring: Ring, threads: NonZeroUsize) -> Result<Vec<Rows>, ProblemError> {
    let angles: Vec<f64> = (0..ring.count()).map(|beam| ring.angle_deg(beam)).collect();
    let beams = engine.beams(&angles, threads)?;
    let rows = |beam: &BeamInfluence| {
        Rows::from_columns(beam.dose.view()).map_err(|e| ProblemError::Rows(e.to_string()))
    };
    beams.iter().map(rows).collect()
}
