//! The fluence problem: a sum of one-sided squares of doses, over weights that are not negative.

use std::num::NonZeroUsize;
use std::sync::Arc;

use thiserror::Error;

use super::region::{Around, RegionTerm};
use super::rows::Csr;

/// On which side of its goal a term costs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Dose above the goal costs.
    Over,
    /// Dose below the goal costs.
    Under,
}

/// One cost of one row: `weight * max(0, d - goal)^2`, or `weight * max(0, goal - d)^2` for [`Side::Under`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Term {
    /// Row whose dose it judges.
    pub row: u32,
    /// Side that costs.
    pub side: Side,
    /// Gray.
    pub goal: f64,
    /// Per square gray, already divided by the structure's number of voxels.
    pub weight: f64,
}

/// `min F(x) = sum_t weight_t max(0, +-(d_row(t) - goal_t))^2`, `d = A x`, `x >= 0`: (5.1) corrected (SCIENCE F1) without
/// its factor 1/2, as the objectives of a plan are summed, and costs of whole regions beside it. Convex and once
/// differentiable; piecewise quadratic but for the regions.
///
/// A row may have any number of terms, also none, and over-dose goals below under-dose goals.
#[derive(Clone, Debug)]
pub struct Problem {
    matrix: Arc<Csr>,
    /// Ordered by row.
    terms: Vec<Term>,
    /// Where each row's terms start; one more at the end.
    starts: Vec<usize>,
    /// Costs of the rows of a region together.
    regions: Vec<RegionTerm>,
    /// Most threads of its solver.
    threads: NonZeroUsize,
}

/// Why numbers are no fluence problem.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum ProblemError {
    /// A term judges a row that is not there.
    #[error("term {term} judges row {row}, but the matrix has {rows} rows")]
    Row {
        /// Number of the term.
        term: usize,
        /// Its row.
        row: u32,
        /// Rows of the matrix.
        rows: usize,
    },
    /// A goal is not finite.
    #[error("term {term} has the goal {goal} Gy; a goal is a finite number")]
    Goal {
        /// Number of the term.
        term: usize,
        /// Its goal.
        goal: f64,
    },
    /// A weight is negative or not finite.
    #[error("term {term} has the weight {weight}; a weight is finite and not negative")]
    Weight {
        /// Number of the term.
        term: usize,
        /// Its weight.
        weight: f64,
    },
    /// The weight of a bixel is negative or not finite.
    #[error("bixel {bixel} has the weight {weight}; a weight is finite and not negative")]
    Fluence {
        /// Number of the bixel.
        bixel: usize,
        /// Its weight.
        weight: f64,
    },
    /// The objective of zero fluence is beyond the numbers.
    #[error(
        "weights or goals are so large that the objective at zero fluence is not finite; scale them down"
    )]
    Overflow,
    /// Arrays that belong together differ in length.
    #[error("{what} has {found} numbers, {expected} are expected")]
    Length {
        /// Which array.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The length due.
        expected: usize,
    },
}

impl Problem {
    /// The problem of these terms, in any order; terms of weight zero are dropped.
    pub fn new(
        matrix: impl Into<Arc<Csr>>,
        terms: impl IntoIterator<Item = Term>,
    ) -> Result<Self, ProblemError> {
        let matrix = matrix.into();
        let rows = matrix.rows();
        let mut retained = Vec::new();
        for (i, term) in terms.into_iter().enumerate() {
            if term.row as usize >= rows {
                return Err(ProblemError::Row { term: i, row: term.row, rows });
            }
            if !term.goal.is_finite() {
                return Err(ProblemError::Goal { term: i, goal: term.goal });
            }
            if !(term.weight.is_finite() && term.weight >= 0.0) {
                return Err(ProblemError::Weight { term: i, weight: term.weight });
            }
            if term.weight > 0.0 {
                retained.push(term);
            }
        }
        retained.sort_by_key(|term| term.row);
        let mut starts = vec![0; rows + 1];
        for term in &retained {
            starts[term.row as usize + 1] += 1;
        }
        for row in 0..rows {
            starts[row + 1] += starts[row];
        }
        let problem =
            Self { matrix, terms: retained, starts, regions: Vec::new(), threads: NonZeroUsize::MIN };
        problem.checked()
    }

    fn checked(self) -> Result<Self, ProblemError> {
        match self.objective(&vec![0.0; self.matrix.rows()]).is_finite() {
            true => Ok(self),
            false => Err(ProblemError::Overflow),
        }
    }

    /// The same problem with costs of regions as well; those of weight zero are dropped.
    pub(super) fn with_regions(mut self, mut regions: Vec<RegionTerm>) -> Result<Self, ProblemError> {
        regions.retain(|region| region.weight > 0.0);
        self.regions.extend(regions);
        self.checked()
    }

    /// The same problem with other terms of its rows.
    pub(super) fn with_terms(&self, terms: Vec<Term>) -> Result<Self, ProblemError> {
        let problem = Self::new(self.shared_matrix(), terms)?.on_threads(self.threads);
        problem.with_regions(self.regions.clone())
    }

    /// Costs of the rows of a region together.
    pub(super) fn regions(&self) -> &[RegionTerm] {
        &self.regions
    }

    /// The problem with an over-dose and an under-dose term for each row.
    pub fn from_bounds(
        matrix: impl Into<Arc<Csr>>,
        hi: &[f64],
        lo: &[f64],
        over: &[f64],
        under: &[f64],
    ) -> Result<Self, ProblemError> {
        let matrix = matrix.into();
        let expected = matrix.rows();
        for (what, array) in [("hi", hi), ("lo", lo), ("over", over), ("under", under)] {
            if array.len() != expected {
                return Err(ProblemError::Length { what, found: array.len(), expected });
            }
        }
        let of = |row: usize, side, goal, weight| Term { row: row as u32, side, goal, weight };
        let terms = (0..expected)
            .flat_map(|i| [of(i, Side::Over, hi[i], over[i]), of(i, Side::Under, lo[i], under[i])]);
        Self::new(matrix, terms)
    }

    /// The matrix.
    pub fn matrix(&self) -> &Csr {
        &self.matrix
    }

    /// The same matrix, to be shared with another problem.
    pub fn shared_matrix(&self) -> Arc<Csr> {
        Arc::clone(&self.matrix)
    }

    /// The same problem with no weight larger than `cap`.
    pub fn capped(&self, cap: f64) -> Self {
        let mut capped = self.clone();
        capped.terms.iter_mut().for_each(|term| term.weight = term.weight.min(cap));
        capped.regions.iter_mut().for_each(|region| region.weight = region.weight.min(cap));
        capped
    }

    /// The same problem, solved on at most so many threads. The solution is the same for any number.
    #[must_use]
    pub fn on_threads(self, threads: NonZeroUsize) -> Self {
        Self { threads, ..self }
    }

    /// Most threads that work on it.
    pub fn threads(&self) -> NonZeroUsize {
        self.threads
    }

    /// The doses of weights: `dose = A x`.
    pub fn doses(&self, x: &[f64], dose: &mut [f64]) {
        self.matrix.forward(x, dose, self.threads);
    }

    /// The slope in each weight, of slopes in the doses: `slope = A^T pull`.
    pub fn slopes(&self, pull: &[f64], slope: &mut [f64]) {
        self.matrix.adjoint(pull, slope, self.threads);
    }

    /// A problem like it for a start: every `step`-th of the first `of` rows stands for those between, and the rows behind
    /// them are kept.
    pub fn thinned(&self, of: usize, step: usize) -> Self {
        let row = |row: usize| if row < of { row / step } else { row - of + of.div_ceil(step) };
        let retained = self
            .terms
            .iter()
            .filter(|term| term.row as usize >= of || (term.row as usize).is_multiple_of(step));
        let terms: Vec<Term> = retained
            .map(|term| {
                let share = if (term.row as usize) < of { step as f64 } else { 1.0 };
                Term { row: row(term.row as usize) as u32, weight: share * term.weight, ..*term }
            })
            .collect();
        let matrix = Arc::new(self.matrix.thinned(of, step));
        let mut starts = vec![0; matrix.rows() + 1];
        terms.iter().for_each(|term| starts[term.row as usize + 1] += 1);
        (0..matrix.rows()).for_each(|row| starts[row + 1] += starts[row]);
        let regions = self.regions.iter().map(|region| region.thinned(of, step)).collect();
        Self { matrix, terms, starts, regions, threads: self.threads }
    }

    /// The terms that cost, ordered by row.
    pub fn terms(&self) -> &[Term] {
        &self.terms
    }

    /// Terms of a row.
    #[inline]
    pub fn terms_of(&self, row: usize) -> &[Term] {
        &self.terms[self.starts[row]..self.starts[row + 1]]
    }

    /// `F` of these doses.
    pub fn objective(&self, dose: &[f64]) -> f64 {
        let mut objective = self.terms.iter().map(|term| term.cost(dose[term.row as usize])).sum();
        for region in &self.regions {
            objective += region.cost(dose);
        }
        objective
    }

    /// `dF/dd` of these doses.
    pub fn dose_gradient(&self, dose: &[f64], out: &mut [f64]) {
        out.fill(0.0);
        for term in &self.terms {
            out[term.row as usize] += term.slope(dose[term.row as usize]);
        }
        for region in &self.regions {
            let Some(Around { slope, mean_slopes, .. }) = region.around(dose) else { continue };
            for ((row, _), g) in region.rows.iter().zip(mean_slopes) {
                out[*row as usize] += slope * g;
            }
        }
    }

    /// `d^2F/dd^2` of each row at these doses, but for what regions bend by their means.
    pub fn curvatures(&self, dose: &[f64]) -> Vec<f64> {
        let of_row = |(row, dose): (usize, &f64)| -> f64 {
            self.terms_of(row).iter().map(|term| term.curvature(*dose)).sum()
        };
        let mut curvatures: Vec<f64> = dose.iter().enumerate().map(of_row).collect();
        for region in &self.regions {
            let Some(Around { diagonal, .. }) = region.around(dose) else { continue };
            for ((row, _), own) in region.rows.iter().zip(diagonal) {
                curvatures[*row as usize] += own;
            }
        }
        curvatures
    }

    /// What regions bend by their means at these doses: a curvature and a direction over the columns each. One that is
    /// negative is left out, so that the whole is not less than the curvature.
    pub fn bends(&self, dose: &[f64]) -> Vec<(f64, Vec<f64>)> {
        let mut bends = Vec::new();
        for region in &self.regions {
            let Some(Around { mean_slopes, bend, .. }) = region.around(dose) else { continue };
            if bend > 0.0 {
                let mut direction = vec![0.0; self.matrix.columns()];
                for ((row, _), g) in region.rows.iter().zip(mean_slopes) {
                    self.matrix.add_row(*row as usize, g, &mut direction);
                }
                bends.push((bend, direction));
            }
        }
        bends
    }

    /// Scale of the curvature of each row's cost: all its terms active, and regions at an even dose.
    pub fn largest_curvatures(&self) -> Vec<f64> {
        let of_row = |row: usize| -> f64 { self.terms_of(row).iter().map(|term| 2.0 * term.weight).sum() };
        let mut curvatures: Vec<f64> = (0..self.matrix.rows()).map(of_row).collect();
        for region in &self.regions {
            for (row, share) in &region.rows {
                curvatures[*row as usize] += 2.0 * region.weight * share;
            }
        }
        curvatures
    }

    /// For each column the curvature along it with all terms active: `sum_i c_i a_ij^2`.
    pub fn largest_diagonal(&self) -> Vec<f64> {
        let mut diagonal = vec![0.0; self.matrix.columns()];
        for (row, curvature) in self.largest_curvatures().into_iter().enumerate() {
            if curvature > 0.0 {
                let (columns, values) = self.matrix.row(row);
                for (c, v) in columns.iter().zip(values) {
                    diagonal[*c as usize] += curvature * f64::from(*v) * f64::from(*v);
                }
            }
        }
        diagonal
    }
}

impl Term {
    /// How far the dose is on the side that costs, Gy; not positive where it is not.
    #[inline]
    pub fn excess(&self, dose: f64) -> f64 {
        match self.side {
            Side::Over => dose - self.goal,
            Side::Under => self.goal - dose,
        }
    }

    /// Its part of the objective.
    #[inline]
    pub fn cost(&self, dose: f64) -> f64 {
        let excess = self.excess(dose).max(0.0);
        self.weight * excess * excess
    }

    /// Its part of `dF/dd`.
    #[inline]
    pub fn slope(&self, dose: f64) -> f64 {
        let size = 2.0 * self.weight * self.excess(dose).max(0.0);
        match self.side {
            Side::Over => size,
            Side::Under => -size,
        }
    }

    /// Its part of `d^2F/dd^2`.
    #[inline]
    pub fn curvature(&self, dose: f64) -> f64 {
        if self.excess(dose) > 0.0 { 2.0 * self.weight } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Csc;

    /// Where neighbours are alike, a part of them stands for all: the thinned problem has the same objective.
    #[test]
    fn a_thinned_problem_stands_for_the_whole() {
        let (of, step) = (10_u32, 4);
        let dose_of = |row: u32| 1.0 + (row / step) as f32;
        let row: Vec<u32> = (0..of + 2).collect();
        let value: Vec<f32> = row.iter().map(|row| if *row < of { dose_of(*row) } else { 0.5 }).collect();
        let matrix = Csc::new(of as usize + 2, vec![0, row.len() as u64], row.clone(), value).unwrap();
        let term = |row: u32| Term { row, side: Side::Under, goal: 60.0, weight: 0.25 };
        let over = |row: u32| Term { row, side: Side::Over, goal: 1.0, weight: 2.0 };
        let terms = row.iter().map(|row| term(*row)).chain([over(of + 1), over(3)]);
        let whole = Problem::new(Csr::from_columns(matrix.view()), terms).unwrap();
        let thin = whole.thinned(of as usize, step as usize);
        assert_eq!(thin.matrix().rows(), 3 + 2);
        let values: Vec<f32> = (0..5).map(|row| thin.matrix().row(row).1[0]).collect();
        assert_eq!(values, [1.0, 2.0, 3.0, 0.5, 0.5]);
        let weights: Vec<_> = thin.terms().iter().map(|t| (t.row, t.weight, t.side)).collect();
        let (under, over) = (Side::Under, Side::Over);
        assert_eq!(
            weights,
            [
                (0, 1.0, under),
                (1, 1.0, under),
                (2, 1.0, under),
                (3, 0.25, under),
                (4, 0.25, under),
                (4, 2.0, over)
            ]
        );
        assert_eq!(thin.terms_of(4).len(), 2);
    }
}
