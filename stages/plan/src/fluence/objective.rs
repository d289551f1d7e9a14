//! What can be wanted of a structure, and what it adds to a problem.

use serde::Serialize;

use super::goals::GoalsError;
use super::problem::{Side, Term};
use super::rows::Csr;

/// One wish for a structure of `v` voxels. Doses are in gray; each costs nothing where it is fulfilled.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Objective {
    /// `weight / v sum max(0, d - dose)^2`.
    Overdose {
        /// Gray.
        #[serde(rename = "dose_gy")]
        dose: f64,
        /// Weight.
        weight: f64,
    },
    /// `weight / v sum max(0, dose - d)^2`.
    Underdose {
        /// Gray.
        #[serde(rename = "dose_gy")]
        dose: f64,
        /// Weight.
        weight: f64,
    },
    /// `weight max(0, mean - dose)^2`.
    MeanDose {
        /// Gray.
        #[serde(rename = "dose_gy")]
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
        #[serde(rename = "dose_gy")]
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
        #[serde(rename = "dose_gy")]
        dose: f64,
        /// Fraction of the structure.
        volume: f64,
        /// Weight.
        weight: f64,
    },
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

/// What objectives add to a problem.
#[derive(Default)]
pub(super) struct Parts {
    pub terms: Vec<Term>,
    pub dvh: Vec<DvhPoint>,
    /// Of each row behind those of voxels, the rows that it averages.
    pub averages: Vec<Vec<u32>>,
}

impl Objective {
    /// The same with its weight times `factor`.
    #[must_use]
    pub fn scaled(mut self, factor: f64) -> Self {
        match &mut self {
            Self::Overdose { weight, .. }
            | Self::Underdose { weight, .. }
            | Self::MeanDose { weight, .. }
            | Self::Homogeneity { weight }
            | Self::DvhAtMost { weight, .. }
            | Self::DvhAtLeast { weight, .. } => *weight *= factor,
        }
        self
    }

    pub(super) fn check(&self, name: &str) -> Result<(), GoalsError> {
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
    pub(super) fn add(&self, rows: &[u32], matrix: &mut Csr, bixels: usize, parts: &mut Parts) {
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
