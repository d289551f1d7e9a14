//! What is wanted of a plan, structure by structure, and the fluence problem that it makes of dose matrices.

use std::num::NonZeroUsize;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::dvh::DvhTerm;
use super::modulation::Modulation;
use super::problem::{Problem, ProblemError};
use super::rows::Csr;
use super::shapes::{Objective, Parts, Region};
use crate::Setups;

/// A structure with its objectives.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StructureObjectives {
    /// Its name, for errors.
    pub name: String,
    /// Its voxels, rows of the dose matrices, rising. Structures may overlap: a voxel then has the costs of each.
    pub voxels: Vec<u32>,
    /// Volume that each voxel stands for, in any one unit; none where all are alike.
    pub volumes: Vec<f64>,
    /// Distance of each voxel to the nearest target, mm, not negative; none where no objective asks for it.
    pub to_target_mm: Vec<f64>,
    /// Its objectives.
    pub objectives: Vec<Objective>,
}

/// Why wishes cannot be used.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum GoalsError {
    /// A structure has objectives but no voxel.
    #[error("{name} has no voxel on the dose grid; use a finer grid, or leave its objectives out")]
    Empty {
        /// The structure.
        name: String,
    },
    /// Voxels do not rise, or lie outside the grid.
    #[error(
        "the voxels of {name} must rise and be within the {voxels} of the dose grid; number {at} does not"
    )]
    Voxel {
        /// The structure.
        name: String,
        /// Place in its list.
        at: usize,
        /// Voxels of the grid.
        voxels: usize,
    },
    /// Volumes do not belong to the voxels, or one is not positive.
    #[error(
        "{name} has {voxels} voxels and {volumes} volumes; each voxel needs one that is finite and positive"
    )]
    Volumes {
        /// The structure.
        name: String,
        /// Its voxels.
        voxels: usize,
        /// Volumes given.
        volumes: usize,
    },
    /// Distances to the targets that do not belong to the voxels, or are none.
    #[error(
        "{name} has {voxels} voxels and {distances} distances to the targets; for its fall-off each voxel needs one that is not negative"
    )]
    Distances {
        /// The structure.
        name: String,
        /// Its voxels.
        voxels: usize,
        /// Distances given.
        distances: usize,
    },
    /// A number of an objective is out of its range.
    #[error("{name}: {what} is {value}; it must be {range}")]
    Number {
        /// The structure.
        name: String,
        /// Name of the quantity.
        what: &'static str,
        /// Its value.
        value: f64,
        /// What it may be.
        range: &'static str,
    },
    /// A dose matrix is on another grid.
    #[error("a dose matrix has {found} rows, the dose grid {expected} voxels")]
    Grid {
        /// Rows of the matrix.
        found: usize,
        /// Voxels of the grid.
        expected: usize,
    },
    /// The numbers make no problem.
    #[error(transparent)]
    Problem(#[from] ProblemError),
}

/// Marks a voxel that no objective needs.
const LEFT_OUT: u32 = u32::MAX;

/// Checked wishes: what a plan is measured by.
#[derive(Clone, Debug)]
pub struct Goals {
    structures: Vec<StructureObjectives>,
    /// Row of each voxel of the dose grid, or `u32::MAX` where no objective needs it.
    row_of: Vec<u32>,
    /// Voxel of each row.
    voxels: Vec<u32>,
    /// What uneven fluence costs.
    modulation: Option<Modulation>,
}

/// The goals on some beams: a convex problem, and the DVH points that it lacks.
#[derive(Clone, Debug)]
pub struct PlanProblem {
    /// All but the DVH points.
    pub(super) convex: Problem,
    pub(super) dvh: Vec<DvhTerm>,
    /// Columns that are bixels; behind them stand the means of homogeneity objectives.
    pub(super) bixels: usize,
    /// Rows that are voxels.
    pub(super) voxel_rows: usize,
    /// Of each row behind those, the voxel rows that it averages, with their shares.
    pub(super) averages: Vec<Vec<(u32, f64)>>,
}

impl Goals {
    /// Checks wishes on a dose grid of `voxels`.
    pub fn new(structures: Vec<StructureObjectives>, voxels: usize) -> Result<Self, GoalsError> {
        let mut row_of = vec![LEFT_OUT; voxels];
        for structure in structures.iter().filter(|w| !w.objectives.is_empty()) {
            let name = || structure.name.clone();
            if structure.voxels.is_empty() {
                return Err(GoalsError::Empty { name: name() });
            }
            let volumes = &structure.volumes;
            let alike = volumes.is_empty() || volumes.len() == structure.voxels.len();
            if !alike || !volumes.iter().all(|v| v.is_finite() && *v > 0.0) {
                let (voxels, volumes) = (structure.voxels.len(), volumes.len());
                return Err(GoalsError::Volumes { name: name(), voxels, volumes });
            }
            let mut next = 0;
            for (at, voxel) in structure.voxels.iter().enumerate() {
                if (*voxel as usize) < next || *voxel as usize >= voxels {
                    return Err(GoalsError::Voxel { name: name(), at, voxels });
                }
                next = *voxel as usize + 1;
                row_of[*voxel as usize] = 0;
            }
            for objective in &structure.objectives {
                objective.check(&structure.name)?;
                let distances = &structure.to_target_mm;
                let known = distances.len() == structure.voxels.len() && distances.iter().all(|r| *r >= 0.0);
                if objective.needs_distances() && !known {
                    let (voxels, distances) = (structure.voxels.len(), distances.len());
                    return Err(GoalsError::Distances { name: name(), voxels, distances });
                }
            }
        }
        let needed = (0..voxels as u32).filter(|v| row_of[*v as usize] != LEFT_OUT).collect::<Vec<_>>();
        for (row, voxel) in needed.iter().enumerate() {
            row_of[*voxel as usize] = row as u32;
        }
        Ok(Self { structures, row_of, voxels: needed, modulation: None })
    }

    /// The same goals, for which uneven fluence costs this, too.
    ///
    /// # Errors
    /// A number is out of range.
    pub fn modulated(self, modulation: Option<Modulation>) -> Result<Self, GoalsError> {
        modulation.iter().try_for_each(Modulation::check)?;
        Ok(Self { modulation, ..self })
    }

    /// What uneven fluence costs.
    pub fn modulation(&self) -> Option<Modulation> {
        self.modulation
    }

    /// Voxels that an objective needs, rising: rows of the problems are these, in this order.
    pub fn voxels(&self) -> &[u32] {
        &self.voxels
    }

    /// Rows that a dose matrix must have: voxels of the dose grid, in every set-up.
    pub fn rows(&self) -> usize {
        self.row_of.len()
    }

    /// The structures.
    pub fn structures(&self) -> &[StructureObjectives] {
        &self.structures
    }

    /// The problem of these dose matrices side by side, restricted to the rows that an objective needs.
    pub fn problem(&self, beams: &[Setups<'_>]) -> Result<PlanProblem, GoalsError> {
        if let Some(other) = beams.iter().find(|beam| beam.rows() != self.rows()) {
            return Err(GoalsError::Grid { found: other.rows(), expected: self.rows() });
        }
        let mut matrix = Csr::of_beams(beams, &self.voxels);
        let (bixels, voxel_rows) = (matrix.columns(), matrix.rows());
        let mut parts = Parts {
            matrix: &mut matrix,
            bixels,
            terms: Vec::new(),
            dvh: Vec::new(),
            regions: Vec::new(),
            averages: Vec::new(),
        };
        for structure in self.structures.iter().filter(|w| !w.objectives.is_empty()) {
            let rows: Vec<u32> = structure.voxels.iter().map(|v| self.row_of[*v as usize]).collect();
            let alike = vec![1.0; if structure.volumes.is_empty() { rows.len() } else { 0 }];
            let volumes = if structure.volumes.is_empty() { &alike } else { &structure.volumes };
            let region = Region { rows: &rows, volumes, to_target_mm: &structure.to_target_mm };
            for objective in &structure.objectives {
                objective.add(region, &mut parts);
            }
        }
        if let Some(modulation) = &self.modulation {
            modulation.add(beams, &mut parts);
        }
        let Parts { terms, dvh, regions, averages, .. } = parts;
        let convex = Problem::new(matrix, terms)?.with_regions(regions)?;
        Ok(PlanProblem { convex, dvh, bixels, voxel_rows, averages })
    }
}

impl PlanProblem {
    /// The same problem, solved on at most so many threads. The plan is the same for any number.
    #[must_use]
    pub fn on_threads(self, threads: NonZeroUsize) -> Self {
        Self { convex: self.convex.on_threads(threads), ..self }
    }
}
