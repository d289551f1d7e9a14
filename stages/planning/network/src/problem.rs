//! A case with goals and coarse doses, on which sets of beams are solved fast.

use std::num::NonZeroUsize;

use serde::{Deserialize, Serialize};
use stillpoint_patient::case::{Case, Role};
use stillpoint_plan::Rows;
use stillpoint_plan::beams::Ring;
use stillpoint_plan::distance::distances_mm;
use stillpoint_plan::dose::{BixelSpec, DoseEngine, DoseError, DoseParams, Machine};
use stillpoint_plan::fluence::{Goals, GoalsError, StructureObjectives};
use stillpoint_plan::objectives::{ObjectiveSetError, ObjectiveTable, follows};
use thiserror::Error;

/// Within this distance of a target more points of the patient count, mm.
const NEAR_MM: f32 = 20.0;

/// How coarse doses are.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Coarseness {
    /// Spacing of the dose grid, mm.
    pub grid_mm: f64,
    /// Width of a bixel, mm.
    pub bixel_mm: f64,
}

/// What is solved.
pub struct Problem {
    /// The patient.
    pub case: Case,
    /// The objectives, structure by structure; voxels are rows of the doses.
    pub wanted: Vec<StructureObjectives>,
    /// The same, checked.
    pub goals: Goals,
    engine: DoseEngine,
}

/// Why there is nothing to solve.
#[derive(Debug, Error)]
pub enum ProblemError {
    /// The objectives do not fit the case.
    #[error(transparent)]
    ObjectiveSet(#[from] ObjectiveSetError),
    /// The objectives make no goals.
    #[error(transparent)]
    Goals(#[from] GoalsError),
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
        let params = DoseParams {
            bixels: BixelSpec::of_width(coarse.bixel_mm),
            ..DoseParams::over(case.grid(), coarse.grid_mm)
        };
        let grid = params.grid;
        let mut wanted = table.for_case(&case, &grid)?.structures;
        let targets: Vec<bool> = {
            let mut inside = vec![false; grid.len()];
            let of_targets = wanted.iter().filter(|w| role(&case, &w.name) == Some(Role::Target));
            of_targets.flat_map(|w| &w.voxels).for_each(|v| inside[*v as usize] = true);
            inside
        };
        let to_target_mm = distances_mm(&grid, |voxel| targets[voxel]);
        for structure in &mut wanted {
            let role = role(&case, &structure.name);
            // Voxels that count of each zone are one in so many.
            let zone = |voxel: u32| -> usize {
                match role {
                    Some(Role::Target) => 0,
                    Some(Role::Organ) => 1,
                    _ if to_target_mm[voxel as usize] <= NEAR_MM => 1,
                    _ => 2,
                }
            };
            let counts = |voxel: u32| {
                let [x, y, z] = grid.voxel(voxel as usize);
                match zone(voxel) {
                    0 => true,
                    1 => (x + y + z) % 2 == 0,
                    _ => x % 3 == 0 && y % 3 == 0 && z % 2 == 0,
                }
            };
            thin(structure, zone, counts);
        }
        wanted.retain(|w| !w.voxels.is_empty());
        let mut samples: Vec<u32> = wanted.iter().flat_map(|w| w.voxels.iter().copied()).collect();
        samples.sort_unstable();
        samples.dedup();
        for voxel in wanted.iter_mut().flat_map(|w| &mut w.voxels) {
            *voxel = samples.binary_search(voxel).unwrap_or_default() as u32;
        }
        let goals = Goals::new(wanted.clone(), samples.len())?;
        let engine = DoseEngine::of_case(&case, machine, params)?.sampled(samples);
        Ok(Self { case, wanted, goals, engine })
    }

    /// The dose matrices of all beams of a ring.
    pub fn doses(&self, ring: Ring, threads: NonZeroUsize) -> Result<Vec<Rows>, ProblemError> {
        of_ring(&self.engine, ring, threads)
    }

    /// The same to the patient moved by so much along his axes (mm), to the rows of what moves through the beams; 0 elsewhere.
    pub fn displaced(
        &self,
        ring: Ring,
        shift_mm: [f64; 3],
        threads: NonZeroUsize,
    ) -> Result<Vec<Rows>, ProblemError> {
        let [moving, _] = self.parts()?;
        let engine = self.engine.within(moving.voxels()).shifted(shift_mm)?;
        of_ring(&engine, ring, threads)
    }

    /// The goals in two parts: of what moves through the beams with the patient, and of the outline, which counts as planned.
    pub fn parts(&self) -> Result<[Goals; 2], GoalsError> {
        let moves = |wanted: &&StructureObjectives| role(&self.case, &wanted.name).is_some_and(follows);
        let part = |of: bool| {
            let wanted = self.wanted.iter().filter(|wanted| moves(wanted) == of).cloned();
            Goals::new(wanted.collect(), self.rows())
        };
        Ok([part(true)?, part(false)?])
    }

    /// Rows of the dose matrices.
    pub fn rows(&self) -> usize {
        self.engine.rows()
    }
}

fn of_ring(engine: &DoseEngine, ring: Ring, threads: NonZeroUsize) -> Result<Vec<Rows>, ProblemError> {
    let angles: Vec<f64> = (0..ring.count()).map(|beam| ring.angle_deg(beam)).collect();
    let beams = engine.beams(&angles, threads)?;
    let rows = |beam: &stillpoint_plan::dose::BeamInfluence| {
        Rows::from_columns(beam.dose.view()).map_err(|e| ProblemError::Rows(e.to_string()))
    };
    beams.iter().map(rows).collect()
}

fn role(case: &Case, name: &str) -> Option<Role> {
    case.structure(name).map(|s| s.role)
}

/// Keeps the voxels that count. Those of a zone stand for all of it.
fn thin(structure: &mut StructureObjectives, zone: impl Fn(u32) -> usize, counts: impl Fn(u32) -> bool) {
    let (mut all, mut kept) = ([0.0; 3], [0.0; 3]);
    for voxel in &structure.voxels {
        all[zone(*voxel)] += 1.0;
        if counts(*voxel) {
            kept[zone(*voxel)] += 1.0;
        }
    }
    let chosen: Vec<usize> = (0..structure.voxels.len()).filter(|at| counts(structure.voxels[*at])).collect();
    if !structure.to_target_mm.is_empty() {
        structure.to_target_mm = chosen.iter().map(|at| structure.to_target_mm[*at]).collect();
    }
    structure.voxels = chosen.iter().map(|at| structure.voxels[*at]).collect();
    structure.volumes = structure.voxels.iter().map(|v| all[zone(*v)] / kept[zone(*v)]).collect();
}
