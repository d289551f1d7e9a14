//! How far from the optimum a point is, from the point alone.

use super::problem::Problem;

/// What is known of a feasible point of a fluence problem.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Certificate {
    /// `F(x)`.
    pub objective: f64,
    /// Violation of the conditions of the optimum (SCIENCE F1: `g_j = 0` where `x_j > 0`, `g_j >= 0` where `x_j = 0`):
    /// the largest `|min(g_j, D_j x_j)|`, with `D_j` the curvature along column j with all terms active, over the
    /// largest `|g_j|` at `x = 0` or `D_j x_j`, all in columns scaled to `D_j = 1`.
    pub kkt: f64,
    /// Proved bound of `F(x) - F*`; infinite where no bound of the weights follows from the matrix.
    ///
    /// By convexity `F* >= F(x) + g^T (x* - x)`, and `0 <= x*_j <= X_j`: no row of `x*` can cost more than `F(x)`.
    pub excess: f64,
}

impl Certificate {
    /// Of a point with no negative weight. One product with the matrix and one with its transpose.
    pub fn of(problem: &Problem, x: &[f64]) -> Self {
        let matrix = problem.matrix();
        let (rows, n) = (matrix.rows(), matrix.columns());
        let (mut dose, mut pull) = (vec![0.0; rows], vec![0.0; rows]);
        let (mut gradient, mut gradient_zero) = (vec![0.0; n], vec![0.0; n]);
        problem.dose_gradient(&dose, &mut pull);
        problem.slopes(&pull, &mut gradient_zero);
        problem.doses(x, &mut dose);
        problem.dose_gradient(&dose, &mut pull);
        problem.slopes(&pull, &mut gradient);
        let objective = problem.objective(&dose);
        let diagonal = problem.largest_diagonal();
        let largest = largest_weights(problem, objective);
        let (mut violation, mut scale, mut excess) = (0.0_f64, 0.0_f64, 0.0);
        for j in (0..n).filter(|j| diagonal[*j] > 0.0) {
            let (g, root) = (gradient[j], diagonal[j].sqrt());
            let natural = if g > 0.0 { g.min(diagonal[j] * x[j]) } else { -g };
            violation = violation.max(natural / root);
            scale = scale.max(gradient_zero[j].abs() / root).max(root * x[j]);
            excess += if g > 0.0 {
                g * x[j]
            } else if g < 0.0 {
                -g * (largest[j] - x[j]).max(0.0)
            } else {
                0.0
            };
        }
        let kkt = if violation == 0.0 { 0.0 } else { violation / scale };
        Self { objective, kkt, excess: excess.min(objective) }
    }

    /// Proved bound of `(F(x) - F*) / F*`; infinite where `F*` may be zero.
    pub fn relative_excess(&self) -> f64 {
        if self.excess == 0.0 { 0.0 } else { self.excess / (self.objective - self.excess) }
    }
}

/// For each column a weight that no point with an objective of at most `objective` exceeds.
fn largest_weights(problem: &Problem, objective: f64) -> Vec<f64> {
    let matrix = problem.matrix();
    let mut largest = vec![f64::INFINITY; matrix.columns()];
    for row in 0..matrix.rows() {
        let (columns, values) = matrix.row(row);
        if values.iter().any(|v| *v < 0.0) {
            continue;
        }
        let dose = problem.terms_of(row).iter().filter(|term| term.side == super::problem::Side::Over);
        let dose =
            dose.map(|term| term.goal + (objective / term.weight).sqrt()).fold(f64::INFINITY, f64::min);
        if dose.is_finite() {
            for (c, v) in columns.iter().zip(values).filter(|(_, v)| **v > 0.0) {
                let bound = &mut largest[*c as usize];
                *bound = bound.min(dose.max(0.0) / f64::from(*v));
            }
        }
    }
    for region in problem.regions() {
        for (row, share) in &region.rows {
            let dose = region.largest_dose(*share, objective);
            let (columns, values) = matrix.row(*row as usize);
            if dose.is_finite() && values.iter().all(|v| *v >= 0.0) {
                for (c, v) in columns.iter().zip(values).filter(|(_, v)| **v > 0.0) {
                    let bound = &mut largest[*c as usize];
                    *bound = bound.min(dose / f64::from(*v));
                }
            }
        }
    }
    // A column with negative entries (the mean of a homogeneity objective) only lowers rows: under-doses bound it.
    for row in 0..matrix.rows() {
        let (columns, values) = matrix.row(row);
        let negative = |(_, v): &(&u32, &f32)| **v < 0.0;
        let Some((c, v)) = columns.iter().zip(values).find(negative) else { continue };
        let dose = problem.terms_of(row).iter().filter(|term| term.side == super::problem::Side::Under);
        let dose =
            dose.map(|term| term.goal - (objective / term.weight).sqrt()).fold(f64::NEG_INFINITY, f64::max);
        let rest: f64 = columns
            .iter()
            .zip(values)
            .filter(|(_, v)| **v > 0.0)
            .map(|(c, v)| f64::from(*v) * largest[*c as usize])
            .sum();
        let bound = &mut largest[*c as usize];
        *bound = bound.min((rest - dose).max(0.0) / -f64::from(*v));
    }
    largest
}
