//! What is wanted of a plan, structure by structure, and the fluence problem that it makes of dose matrices.

use thiserror::Error;

use super::problem::{Problem, ProblemError, Side, Term};
use super::rows::{Csr, LEFT_OUT};
use crate::CscRef;

/// One wish for a structure of `v` voxels. Doses are in gray; each costs nothing where it is fulfilled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Objective {
    /// `weight / v sum max(0, d - dose)^2`.
    Overdose {
        /// Gray.
        dose: f64,
        /// Weight.
        weight: f64,
    },
    /// `weight / v sum max(0, dose - d)^2`.
    Underdose {
        /// Gray.
        dose: f64,
        /// Weight.
        weight: f64,
    },
    /// `weight max(0, mean - dose)^2`.
    MeanDose {
        /// Gray.
        dose: f64,
        /// Weight.
        weight: f64,
    },
    /// `weight / v sum (d - mean)^2`.
    Homogeneity {
        /// Weight.
        weight: f64,
    },
    /// At most `volume` (a fraction) gets more than `dose`. With `d_v` the dose that `volume` gets now, voxels between
    /// `dose` and `d_v` cost `weight / v (d - dose)^2`; the hottest `volume` is free. Not convex.
    DvhAtMost {
        /// Gray.
        dose: f64,
        /// Fraction of the structure.
        volume: f64,
        /// Weight.
        weight: f64,
    },
    /// At least `volume` (a fraction) gets `dose`. Voxels between `d_v` and `dose` cost `weight / v (dose - d)^2`; the
    /// coldest `1 - volume` is free. Not convex.
    DvhAtLeast {
        /// Gray.
        dose: f64,
        /// Fraction of the structure.
        volume: f64,
        /// Weight.
        weight: f64,
    },
}

/// A structure and what is wanted of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Wanted {
    /// Its name, for errors.
    pub name: String,
    /// Its voxels on the dose grid, rising. Structures may overlap: a voxel then has the costs of each.
    pub voxels: Vec<u32>,
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
        "the voxels of {name} must rise and lie within the {voxels} of the dose grid; number {at} does not"
    )]
    Voxel {
        /// The structure.
        name: String,
        /// Place in its list.
        at: usize,
        /// Voxels of the grid.
        voxels: usize,
    },
    /// A number of an objective is out of its range.
    #[error("{name}: {what} is {value}; it must be {range}")]
    Number {
        /// The structure.
        name: String,
        /// Which number.
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

/// Checked wishes: what a plan is measured by.
#[derive(Clone, Debug)]
pub struct Goals {
    wanted: Vec<Wanted>,
    /// Row of each voxel of the dose grid, or [`LEFT_OUT`] where no objective needs it.
    row_of: Vec<u32>,
    /// Voxel of each row.
    voxels: Vec<u32>,
}

/// A DVH objective whose voxels are chosen by dose.
#[derive(Clone, Debug)]
pub(super) struct DvhPoint {
    /// Rows of the structure.
    pub rows: Vec<u32>,
    /// How many of them cost.
    pub costing: usize,
    pub side: Side,
    pub dose: f64,
    pub weight: f64,
}

/// The goals on some beams: a convex problem, and the DVH points that it lacks.
#[derive(Clone, Debug)]
pub struct PlanProblem {
    /// All but the DVH points.
    pub(super) convex: Problem,
    pub(super) dvh: Vec<DvhPoint>,
    /// Columns that are bixels; behind them stand the means of homogeneity objectives.
    pub(super) bixels: usize,
    /// Rows that are voxels.
    pub(super) voxel_rows: usize,
    /// Of each row behind those, the voxel rows that it averages.
    pub(super) averages: Vec<Vec<u32>>,
}

impl Goals {
    /// Checks wishes on a dose grid of `voxels`.
    pub fn new(wanted: Vec<Wanted>, voxels: usize) -> Result<Self, GoalsError> {
        let mut row_of = vec![LEFT_OUT; voxels];
        for structure in wanted.iter().filter(|w| !w.objectives.is_empty()) {
            let name = || structure.name.clone();
            if structure.voxels.is_empty() {
                return Err(GoalsError::Empty { name: name() });
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
            }
        }
        let needed = (0..voxels as u32).filter(|v| row_of[*v as usize] != LEFT_OUT).collect::<Vec<_>>();
        for (row, voxel) in needed.iter().enumerate() {
            row_of[*voxel as usize] = row as u32;
        }
        Ok(Self { wanted, row_of, voxels: needed })
    }

    /// Voxels that an objective needs, rising: rows of the problems are these, in this order.
    pub fn voxels(&self) -> &[u32] {
        &self.voxels
    }

    /// The structures.
    pub fn wanted(&self) -> &[Wanted] {
        &self.wanted
    }

    /// The problem of these dose matrices side by side, restricted to the rows that an objective needs.
    pub fn problem(&self, beams: &[CscRef<'_>]) -> Result<PlanProblem, GoalsError> {
        if let Some(other) = beams.iter().find(|beam| beam.rows != self.row_of.len()) {
            return Err(GoalsError::Grid { found: other.rows, expected: self.row_of.len() });
        }
        let mut matrix = Csr::from_blocks(beams, &self.row_of, self.voxels.len());
        let (bixels, voxel_rows) = (matrix.columns(), matrix.rows());
        let mut parts = Parts::default();
        for structure in self.wanted.iter().filter(|w| !w.objectives.is_empty()) {
            let rows: Vec<u32> = structure.voxels.iter().map(|v| self.row_of[*v as usize]).collect();
            for objective in &structure.objectives {
                objective.add(&rows, &mut matrix, bixels, &mut parts);
            }
        }
        let Parts { terms, dvh, averages } = parts;
        Ok(PlanProblem { convex: Problem::new(matrix, terms)?, dvh, bixels, voxel_rows, averages })
    }
}

/// What objectives add to a problem.
#[derive(Default)]
struct Parts {
    terms: Vec<Term>,
    dvh: Vec<DvhPoint>,
    averages: Vec<Vec<u32>>,
}

impl Objective {
    fn check(&self, name: &str) -> Result<(), GoalsError> {
        let (dose, volume, weight) = match *self {
            Self::Overdose { dose, weight }
            | Self::Underdose { dose, weight }
            | Self::MeanDose { dose, weight } => (dose, 0.0, weight),
            Self::Homogeneity { weight } => (0.0, 0.0, weight),
            Self::DvhAtMost { dose, volume, weight } | Self::DvhAtLeast { dose, volume, weight } => {
                (dose, volume, weight)
            }
        };
        let bad = |what, value, range| Err(GoalsError::Number { name: name.to_owned(), what, value, range });
        if !(dose.is_finite() && dose >= 0.0) {
            return bad("a dose", dose, "a finite number of gray, not negative");
        }
        if !(0.0..=1.0).contains(&volume) {
            return bad("a volume", volume, "a fraction between 0 and 1");
        }
        if !(weight.is_finite() && weight >= 0.0) {
            return bad("a weight", weight, "finite and not negative");
        }
        Ok(())
    }

    /// Adds its terms on `rows`, and the rows and columns of the matrix that they need.
    fn add(&self, rows: &[u32], matrix: &mut Csr, bixels: usize, parts: &mut Parts) {
        let Parts { terms, dvh, averages } = parts;
        let count = rows.len() as f64;
        let mut each = |side, goal, weight: f64| {
            terms.extend(rows.iter().map(|&row| Term { row, side, goal, weight: weight / count }));
        };
        match *self {
            Self::Overdose { dose, weight } => each(Side::Over, dose, weight),
            Self::Underdose { dose, weight } => each(Side::Under, dose, weight),
            Self::MeanDose { dose, weight } => {
                // One more row: the mean over the structure.
                let (columns, means) = mean_row(matrix, rows, bixels);
                let row = matrix.rows() as u32;
                matrix.push_row(&columns, &means);
                averages.push(rows.to_vec());
                terms.push(Term { row, side: Side::Over, goal: dose, weight });
            }
            Self::Homogeneity { weight } => {
                // sum (d - mean)^2 = min_c sum (d - c)^2: one more column, c, and each row once more with -1 in it.
                // The best c is the mean, so it is not negative.
                let column = matrix.columns() as u32;
                matrix.widen(1);
                for row in rows {
                    averages.push(vec![*row]);
                    let (columns, values) = matrix.row(*row as usize);
                    let columns = [columns, &[column]].concat();
                    let values = [values, &[-1.0]].concat();
                    let row = matrix.rows() as u32;
                    matrix.push_row(&columns, &values);
                    for side in [Side::Over, Side::Under] {
                        terms.push(Term { row, side, goal: 0.0, weight: weight / count });
                    }
                }
            }
            Self::DvhAtMost { dose, volume, weight } => {
                let costing = rows.len() - ((volume * count) as usize).min(rows.len());
                dvh.push(DvhPoint {
                    rows: rows.to_vec(),
                    costing,
                    side: Side::Over,
                    dose,
                    weight: weight / count,
                });
            }
            Self::DvhAtLeast { dose, volume, weight } => {
                let costing = ((volume * count).ceil() as usize).min(rows.len());
                dvh.push(DvhPoint {
                    rows: rows.to_vec(),
                    costing,
                    side: Side::Under,
                    dose,
                    weight: weight / count,
                });
            }
        }
    }
}

/// The mean of rows, as a sparse row; rounded to `f32` as every entry is.
fn mean_row(matrix: &Csr, rows: &[u32], bixels: usize) -> (Vec<u32>, Vec<f32>) {
    let mut sums = vec![0.0_f64; bixels];
    for row in rows {
        let (columns, values) = matrix.row(*row as usize);
        for (c, v) in columns.iter().zip(values) {
            sums[*c as usize] += f64::from(*v);
        }
    }
    let columns: Vec<u32> = (0..bixels as u32).filter(|j| sums[*j as usize] != 0.0).collect();
    let means = columns.iter().map(|j| (sums[*j as usize] / rows.len() as f64) as f32).collect();
    (columns, means)
}
