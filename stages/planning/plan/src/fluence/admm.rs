//! The dissertation's solver: the alternating direction method of multipliers, corrected (SCIENCE F2, F3).
//!
//! [`least_squares`] is (D.1)-(D.5); [`solve`] also splits the doses off, for over- and under-dose. Both factor one
//! matrix once. They are a reference for the fast solver and share no code with it.

use std::num::NonZeroUsize;

use faer::Mat;

use super::certificate::Certificate;
use super::cholesky;
use super::problem::{Problem, Term};
use super::rows::Csr;

/// Parameters of the method.
#[derive(Clone, Copy, Debug)]
pub struct Admm {
    /// Penalty of the split; of the order of the weights for [`solve`].
    pub rho: f64,
    /// Over-relaxation.
    pub alpha: f64,
    /// Absolute part of the tolerance, per square root of the number of unknowns.
    pub eps_abs: f64,
    /// Relative part of the tolerance.
    pub eps_rel: f64,
    /// Most iterations.
    pub max_iterations: usize,
}

impl Default for Admm {
    /// The dissertation's alpha, rho and absolute tolerance; the relative one is that for comparing plans.
    fn default() -> Self {
        Self { rho: 1.5, alpha: 1.5, eps_abs: 1e-4, eps_rel: 1e-4, max_iterations: 10_000 }
    }
}

/// Norms by which the method ends: it does where both residuals are within their tolerances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Residuals {
    /// `|x - z|`.
    pub primal: f64,
    /// `rho |z - z before|`.
    pub dual: f64,
    /// Tolerance of `primal`.
    pub primal_tolerance: f64,
    /// Tolerance of `dual`.
    pub dual_tolerance: f64,
}

impl Residuals {
    /// Whether both are within their tolerances.
    pub fn settled(&self) -> bool {
        self.primal <= self.primal_tolerance && self.dual <= self.dual_tolerance
    }
}

/// What the method ended with.
#[derive(Clone, Debug)]
pub struct AdmmSolution {
    /// Weights: the projected copy, so none is negative.
    pub z: Vec<f64>,
    /// Multipliers of `z >= 0`: `lambda`, unscaled.
    pub lambda: Vec<f64>,
    /// Residuals of each iteration.
    pub history: Vec<Residuals>,
}

/// Why the method cannot run.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
pub enum AdmmError {
    /// A parameter is out of its range.
    #[error("{name} is {value}; it must be {range}")]
    Parameter {
        /// Its name.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What it may be.
        range: &'static str,
    },
    /// The matrix is too badly scaled to be factored.
    #[error("the matrix of the x update is not positive definite in double precision; scale the dose matrix")]
    Factor,
    /// The right side does not fit.
    #[error("the right side has {found} numbers, the matrix {expected} rows")]
    Length {
        /// Numbers given.
        found: usize,
        /// Rows of the matrix.
        expected: usize,
    },
}

impl Admm {
    fn check(&self) -> Result<(), AdmmError> {
        let bad = |name, value, range| Err(AdmmError::Parameter { name, value, range });
        if !(self.rho > 0.0 && self.rho.is_finite()) {
            return bad("rho", self.rho, "positive and finite");
        }
        if !(self.alpha > 0.0 && self.alpha < 2.0) {
            return bad("alpha", self.alpha, "between 0 and 2");
        }
        for (name, value) in [("eps_abs", self.eps_abs), ("eps_rel", self.eps_rel)] {
            if !(value >= 0.0 && value.is_finite()) {
                return bad(name, value, "finite and not negative");
            }
        }
        Ok(())
    }
}

/// `min |A x - b|^2 / 2` over `x >= 0`, (D.1)-(D.5) in the corrected form, from zero.
pub fn least_squares(matrix: &Csr, b: &[f64], admm: &Admm) -> Result<AdmmSolution, AdmmError> {
    admm.check()?;
    if b.len() != matrix.rows() {
        return Err(AdmmError::Length { found: b.len(), expected: matrix.rows() });
    }
    let n = matrix.columns();
    let mut factor = normal_matrix(matrix, admm.rho);
    cholesky::factor(factor.as_mut(), NonZeroUsize::MIN).ok_or(AdmmError::Factor)?;
    let mut right = vec![0.0; n];
    matrix.adjoint(b, &mut right, NonZeroUsize::MIN);
    let (mut x, mut z, mut lambda) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let mut z_before = vec![0.0; n];
    let mut history = Vec::new();
    for _ in 0..admm.max_iterations {
        for j in 0..n {
            x[j] = right[j] + admm.rho * z[j] - lambda[j];
        }
        cholesky::solve(factor.as_ref(), &mut x); // (D.2)
        z_before.copy_from_slice(&z);
        for j in 0..n {
            let relaxed = admm.alpha * x[j] + (1.0 - admm.alpha) * z[j];
            z[j] = (relaxed + lambda[j] / admm.rho).max(0.0); // (D.3): no l1 term, so no soft threshold
            lambda[j] -= admm.rho * (z[j] - relaxed); // (D.4)
        }
        let root = (n as f64).sqrt();
        let residuals = Residuals {
            primal: distance(&x, &z),
            dual: admm.rho * distance(&z, &z_before),
            primal_tolerance: root * admm.eps_abs + admm.eps_rel * norm(&x).max(norm(&z)),
            dual_tolerance: root * admm.eps_abs + admm.eps_rel * norm(&lambda),
        };
        history.push(residuals);
        if residuals.settled() {
            break;
        }
    }
    Ok(AdmmSolution { z, lambda, history })
}

/// Minimises a fluence problem: SCIENCE F3, scaled duals, doses split off. `D^T D + I` is factored once.
pub fn solve(problem: &Problem, admm: &Admm) -> Result<(AdmmSolution, Certificate), AdmmError> {
    admm.check()?;
    let matrix = problem.matrix();
    let (rows, n) = (matrix.rows(), matrix.columns());
    let mut factor = normal_matrix(matrix, 1.0);
    cholesky::factor(factor.as_mut(), NonZeroUsize::MIN).ok_or(AdmmError::Factor)?;
    let Admm { rho, alpha, .. } = *admm;
    let (mut x, mut z, mut uz, mut dz) = (vec![0.0; n], vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let (mut y, mut uy, mut dy, mut dose) =
        (vec![0.0; rows], vec![0.0; rows], vec![0.0; rows], vec![0.0; rows]);
    let mut pulled = vec![0.0; n];
    let mut history = Vec::new();
    for _ in 0..admm.max_iterations {
        for i in 0..rows {
            dy[i] = y[i] - uy[i];
        }
        matrix.adjoint(&dy, &mut x, NonZeroUsize::MIN);
        for j in 0..n {
            x[j] += z[j] - uz[j];
        }
        cholesky::solve(factor.as_ref(), &mut x);
        matrix.forward(&x, &mut dose, NonZeroUsize::MIN);
        let mut primal = 0.0;
        for i in 0..rows {
            let relaxed = alpha * dose[i] + (1.0 - alpha) * y[i];
            let to = prox(problem.terms_of(i), rho, relaxed + uy[i]);
            uy[i] += relaxed - to;
            dy[i] = to - y[i];
            y[i] = to;
            primal += (dose[i] - to) * (dose[i] - to);
        }
        for j in 0..n {
            let relaxed = alpha * x[j] + (1.0 - alpha) * z[j];
            let to = (relaxed + uz[j]).max(0.0);
            uz[j] += relaxed - to;
            dz[j] = to - z[j];
            z[j] = to;
            primal += (x[j] - to) * (x[j] - to);
        }
        matrix.adjoint(&dy, &mut pulled, NonZeroUsize::MIN);
        for j in 0..n {
            pulled[j] += dz[j];
        }
        let root = ((rows + n) as f64).sqrt();
        let size = (norm(&dose).hypot(norm(&x))).max(norm(&y).hypot(norm(&z)));
        matrix.adjoint(&uy, &mut dz, NonZeroUsize::MIN);
        for j in 0..n {
            dz[j] += uz[j];
        }
        let residuals = Residuals {
            primal: primal.sqrt(),
            dual: rho * norm(&pulled),
            primal_tolerance: root * admm.eps_abs + admm.eps_rel * size,
            dual_tolerance: (n as f64).sqrt() * admm.eps_abs
                + admm.eps_rel * rho * norm(&uy).hypot(norm(&uz)),
        };
        history.push(residuals);
        if residuals.settled() {
            break;
        }
    }
    let certificate = Certificate::of(problem, &z);
    let lambda = uz.iter().map(|u| rho * u).collect();
    Ok((AdmmSolution { z, lambda, history }, certificate))
}

/// `argmin_y sum_t weight_t max(0, +-(y - goal_t))^2 + rho (y - v)^2 / 2`: the zero of a rising piecewise linear
/// function, exact.
pub fn prox(terms: &[Term], rho: f64, v: f64) -> f64 {
    let slope = |y: f64| terms.iter().map(|term| term.slope(y)).sum::<f64>() + rho * (y - v);
    let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
    for goal in terms.iter().map(|term| term.goal) {
        if slope(goal) <= 0.0 {
            low = goal.max(low)
        } else {
            high = goal.min(high)
        };
    }
    // Within the piece between two goals a term is active or not as it is anywhere inside.
    let inside = match (low.is_finite(), high.is_finite()) {
        (true, true) => f64::midpoint(low, high),
        (true, false) => low + 1.0 + low.abs(),
        (false, true) => high - 1.0 - high.abs(),
        (false, false) => v,
    };
    let (mut top, mut bottom) = (rho * v, rho);
    for term in terms {
        let curvature = term.curvature(inside);
        top += curvature * term.goal;
        bottom += curvature;
    }
    top / bottom
}

/// `A^T A + rho I`, dense, lower triangle.
fn normal_matrix(matrix: &Csr, rho: f64) -> Mat<f64> {
    let n = matrix.columns();
    let mut product = Mat::zeros(n, n);
    for row in 0..matrix.rows() {
        let (columns, values) = matrix.row(row);
        for (k, (c, v)) in columns.iter().zip(values).enumerate() {
            let into = product.col_as_slice_mut(*c as usize);
            for (c, w) in columns[k..].iter().zip(&values[k..]) {
                into[*c as usize] += f64::from(*v) * f64::from(*w);
            }
        }
    }
    for j in 0..n {
        product[(j, j)] += rho;
    }
    product
}

fn norm(a: &[f64]) -> f64 {
    a.iter().map(|a| a * a).sum::<f64>().sqrt()
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}
