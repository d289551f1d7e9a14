//! What can be wanted of a structure, and what it adds to a problem.

use serde::Serialize;

use super::goals::GoalsError;
use super::problem::{Side, Term};
use super::rows::Csr;

/// One wish for a structure of volume `v`; sums are over its voxels, each by its volume. Doses are in gray; each costs nothing where it is fulfilled.
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
    /// `weight / v sum max(0, d - goal(r))^2`, where `r` is a voxel's distance to the nearest target. The goal falls linearly
    /// from `near` at the target to `far` at `over_mm` and stays there; `v` is the volume within `over_mm`.
    FallOff {
        /// Gray.
        #[serde(rename = "near_gy")]
        near: f64,
        /// Gray, not above `near`.
        #[serde(rename = "far_gy")]
        far: f64,
        /// Millimetres, above 0.
        over_mm: f64,
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

/// Rows of a structure with their volumes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Region<'a> {
    pub rows: &'a [u32],
    /// One for each row.
    pub volumes: &'a [f64],
    /// One for each row where an objective asks for it.
    pub to_target_mm: &'a [f64],
}

/// A DVH objective whose voxels are chosen by dose.
#[derive(Clone, Debug)]
pub(super) struct DvhPoint {
    /// Rows of the structure, with their volumes.
    pub rows: Vec<(u32, f64)>,
    /// Volume that is free, for [`Side::Over`] that of the highest doses; or that must not be, for [`Side::Under`].
    pub volume: f64,
    pub side: Side,
    pub dose: f64,
    /// Per volume.
    pub weight: f64,
}

/// What objectives add to a problem.
#[derive(Default)]
pub(super) struct Parts {
    pub terms: Vec<Term>,
    pub dvh: Vec<DvhPoint>,
    /// Of each row behind those of voxels, the rows that it averages, with their shares.
    pub averages: Vec<Vec<(u32, f64)>>,
}

impl Objective {
    /// The same with its weight times `factor`.
    #[must_use]
    pub fn scaled(mut self, factor: f64) -> Self {
        match &mut self {
            Self::Overdose { weight, .. }
            | Self::FallOff { weight, .. }
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
            Self::FallOff { near, weight, .. } => (near, 0.0, weight),
            Self::Homogeneity { weight } => (0.0, 0.0, weight),
            Self::DvhAtMost { dose, volume, weight } | Self::DvhAtLeast { dose, volume, weight } => {
                (dose, volume, weight)
            }
        };
        let bad = |what, value, range| Err(GoalsError::Number { name: name.to_owned(), what, value, range });
        if !(dose.is_finite() && dose >= 0.0) {
            return bad("a dose", dose, "a finite number of gray, not negative");
        }
        if let Self::FallOff { near, far, over_mm, .. } = *self {
            if !(0.0..=near).contains(&far) {
                return bad(
                    "the dose at the end of a fall-off",
                    far,
                    "between 0 Gy and the dose at its beginning",
                );
            }
            if !(over_mm.is_finite() && over_mm > 0.0) {
                return bad("the length of a fall-off", over_mm, "a finite number of millimetres above 0");
            }
        }
        if !(0.0..=1.0).contains(&volume) {
            return bad("a volume", volume, "a fraction between 0 and 1");
        }
        if !(weight.is_finite() && weight >= 0.0) {
            return bad("a weight", weight, "finite and not negative");
        }
        Ok(())
    }

    /// Adds its terms on a region, and the rows and columns of the matrix that they need.
    pub(super) fn add(&self, region: Region<'_>, matrix: &mut Csr, bixels: usize, parts: &mut Parts) {
        let Parts { terms, dvh, averages } = parts;
        let whole: f64 = region.volumes.iter().sum();
        let both = || region.rows.iter().copied().zip(region.volumes.iter().copied());
        let mut each = |side, goal, weight: f64| {
            terms.extend(both().map(|(row, v)| Term { row, side, goal, weight: weight * v / whole }));
        };
        match *self {
            Self::Overdose { dose, weight } => each(Side::Over, dose, weight),
            Self::Underdose { dose, weight } => each(Side::Under, dose, weight),
            Self::FallOff { near, far, over_mm, weight } => {
                let within: f64 = both()
                    .zip(region.to_target_mm)
                    .filter(|(_, r)| **r <= over_mm)
                    .map(|((_, v), _)| v)
                    .sum();
                let unit = if within > 0.0 { within } else { whole };
                terms.extend(both().zip(region.to_target_mm).map(|((row, v), r)| {
                    let goal = near + (far - near) * (r / over_mm).min(1.0);
                    Term { row, side: Side::Over, goal, weight: weight * v / unit }
                }));
            }
            Self::MeanDose { dose, weight } => {
                // One more row: the mean over the structure.
                let shares: Vec<(u32, f64)> = both().map(|(row, v)| (row, v / whole)).collect();
                let (columns, means) = mean_row(matrix, &shares, bixels);
                let row = matrix.rows() as u32;
                matrix.push_row(&columns, &means);
                averages.push(shares);
                terms.push(Term { row, side: Side::Over, goal: dose, weight });
            }
            Self::Homogeneity { weight } => {
                // sum (d - mean)^2 = min_c sum (d - c)^2: one more column, c, and each row once more with -1 in it.
                // The best c is the mean, so it is not negative.
                let column = matrix.columns() as u32;
                matrix.widen(1);
                for (row, v) in both() {
                    averages.push(vec![(row, 1.0)]);
                    let (columns, values) = matrix.row(row as usize);
                    let columns = [columns, &[column]].concat();
                    let values = [values, &[-1.0]].concat();
                    let row = matrix.rows() as u32;
                    matrix.push_row(&columns, &values);
                    for side in [Side::Over, Side::Under] {
                        terms.push(Term { row, side, goal: 0.0, weight: weight * v / whole });
                    }
                }
            }
            Self::DvhAtMost { dose, volume, weight } => dvh.push(DvhPoint {
                rows: both().collect(),
                volume: volume * whole,
                side: Side::Over,
                dose,
                weight: weight / whole,
            }),
            Self::DvhAtLeast { dose, volume, weight } => dvh.push(DvhPoint {
                rows: both().collect(),
                volume: volume * whole,
                side: Side::Under,
                dose,
                weight: weight / whole,
            }),
        }
    }
}

/// The mean of rows by their shares, as a sparse row; rounded to `f32` as every entry is.
fn mean_row(matrix: &Csr, shares: &[(u32, f64)], bixels: usize) -> (Vec<u32>, Vec<f32>) {
    let mut sums = vec![0.0_f64; bixels];
    for (row, share) in shares {
        let (columns, values) = matrix.row(*row as usize);
        for (c, v) in columns.iter().zip(values) {
            sums[*c as usize] += share * f64::from(*v);
        }
    }
    let columns: Vec<u32> = (0..bixels as u32).filter(|j| sums[*j as usize] != 0.0).collect();
    let means = columns.iter().map(|j| sums[*j as usize] as f32).collect();
    (columns, means)
}
