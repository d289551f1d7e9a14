//! The discrete algebraic Riccati equation, and the gains that follow from it (4.15), SCIENCE D5.
//!
//! The dissertation prints the gain of continuous time. In discrete time
//!
//! ```text
//! P = A^T P A - (A^T P B + N)(R + B^T P B)^-1 (B^T P A + N^T) + Q,   K = (R + B^T P B)^-1 (B^T P A + N^T)
//! ```
//!
//! It is solved by doubling (Chu, Fan, Lin, Wang, Int. J. Control 77 (2004) 767): k steps do what 2^k steps of value
//! iteration do.

use nalgebra::{Complex, DMatrix};

/// Doublings that are tried: 2^60 steps of value iteration.
const DOUBLINGS: usize = 60;

/// What the equation is solved for: the cost `sum x^T Q x + u^T R u + 2 x^T N u` of `x(k+1) = A x + B u`.
#[derive(Clone, Debug)]
pub struct Regulator<'a> {
    /// A, n by n.
    pub a: &'a DMatrix<f64>,
    /// B, n by m.
    pub b: &'a DMatrix<f64>,
    /// Q, n by n, symmetric, not negative.
    pub q: &'a DMatrix<f64>,
    /// R, m by m, symmetric, positive.
    pub r: &'a DMatrix<f64>,
    /// N, n by m; `None` where it is zero.
    pub n: Option<&'a DMatrix<f64>>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// P, n by n: x^T P x is the cost that remains from x.
    pub p: DMatrix<f64>,
    /// K, m by n: u = -K x.
    pub k: DMatrix<f64>,
}

/// Why there is no gain.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RiccatiError {
    /// Matrices that do not fit each other.
    #[error("{what} is {rows} by {columns} where {expected_rows} by {expected_columns} is expected")]
    Shape {
        /// Name of the quantity.
        what: &'static str,
        rows: usize,
        columns: usize,
        /// Rows that it must have.
        expected_rows: usize,
        /// Columns that it must have.
        expected_columns: usize,
    },
    /// A number that is none.
    #[error("{0} has a number that is not finite")]
    NotFinite(&'static str),
    /// R is not positive.
    #[error("R is not positive definite: every input must cost something")]
    FreeInput,
    /// Q is not symmetric, or negative somewhere.
    #[error("Q less N R^-1 N^T is not symmetric and at least zero: the cost has no least value")]
    NegativeCost,
    /// No gain makes the loop stable, or the cost does not see an unstable part.
    #[error(
        "no gain makes the loop stable (spectral radius {radius:.6}): an input must reach, and the cost see, whatever does not \
         die out by itself"
    )]
    NotStabilisable {
        /// Of the loop that came out.
        radius: f64,
    },
}

/// Solves the equation.
///
/// # Errors
/// [`RiccatiError`], where there is no solution with a stable loop.
pub fn dlqr(given: &Regulator<'_>) -> Result<Solution, RiccatiError> {
    let Regulator { a, b, q, r, n } = *given;
    let (states, inputs) = (a.nrows(), b.ncols());
    let expected = [
        ("A", a, states, states),
        ("B", b, states, inputs),
        ("Q", q, states, states),
        ("R", r, inputs, inputs),
    ];
    for (what, matrix, expected_rows, expected_columns) in
        expected.into_iter().chain(n.map(|n| ("N", n, states, inputs)))
    {
        let (rows, columns) = matrix.shape();
        if (rows, columns) != (expected_rows, expected_columns) {
            return Err(RiccatiError::Shape { what, rows, columns, expected_rows, expected_columns });
        }
        if matrix.iter().any(|v| !v.is_finite()) {
            return Err(RiccatiError::NotFinite(what));
        }
    }
    let r_inverse = r.clone().cholesky().ok_or(RiccatiError::FreeInput)?.inverse();
    // With N: u = v - R^-1 N^T x has the same problem in v, without N.
    let (free, cost) = match n {
        Some(n) => (a - b * &r_inverse * n.transpose(), q - n * &r_inverse * n.transpose()),
        None => (a.clone(), q.clone()),
    };
    let asymmetry = (&cost - cost.transpose()).norm();
    let least = symmetric(&cost).symmetric_eigenvalues().min();
    if asymmetry > 1e-9 * cost.norm() || least < -1e-9 * cost.norm() {
        return Err(RiccatiError::NegativeCost);
    }
    let p = doubled(free, b * r_inverse * b.transpose(), symmetric(&cost))
        .ok_or(RiccatiError::NotStabilisable { radius: f64::NAN })?;
    let k = gain(given, &p).ok_or(RiccatiError::NotStabilisable { radius: f64::NAN })?;
    let radius = spectral_radius(&(a - b * &k));
    if radius < 1.0 { Ok(Solution { p, k }) } else { Err(RiccatiError::NotStabilisable { radius }) }
}

/// K of a P.
fn gain(given: &Regulator<'_>, p: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let Regulator { a, b, r, n, .. } = *given;
    let mut across = b.transpose() * p * a;
    if let Some(n) = n {
        across += n.transpose();
    }
    Some((r + b.transpose() * p * b).cholesky()?.solve(&across))
}

/// The limit of H under A <- A W A, G <- G + A W G A^T, H <- H + A^T H W A with W = (I + G H)^-1.
fn doubled(mut a: DMatrix<f64>, mut g: DMatrix<f64>, mut h: DMatrix<f64>) -> Option<DMatrix<f64>> {
    let identity = DMatrix::identity(a.nrows(), a.ncols());
    for _ in 0..DOUBLINGS {
        let factor = (&identity + &g * &h).lu();
        let wa = factor.solve(&a)?;
        let wg = factor.solve(&g)?;
        let more = a.transpose() * &h * &wa;
        g += &a * wg * a.transpose();
        g = symmetric(&g);
        a = &a * wa;
        h += &more;
        h = symmetric(&h);
        if !(more.norm().is_finite() && g.norm().is_finite()) {
            return None;
        }
        if more.norm() <= 1e-15 * h.norm() {
            return Some(h);
        }
    }
    None
}

fn symmetric(m: &DMatrix<f64>) -> DMatrix<f64> {
    (m + m.transpose()) * 0.5
}

/// The largest modulus of the eigenvalues; below 1 the system is stable.
#[must_use]
pub fn spectral_radius(a: &DMatrix<f64>) -> f64 {
    a.complex_eigenvalues().iter().map(|e: &Complex<f64>| libm::hypot(e.re, e.im)).fold(0.0, f64::max)
}

/// The steady gain of the predictor `x(k+1) = A x + B u + K (y - C x)` under noise of covariance `w` in the state and
/// `v` in the output: the dual problem (4.16), with A - K C stable.
///
/// # Errors
/// As [`dlqr`]: there C must see what does not die out, and the noise reach it.
pub fn observer_gain(
    a: &DMatrix<f64>,
    c: &DMatrix<f64>,
    w: &DMatrix<f64>,
    v: &DMatrix<f64>,
) -> Result<DMatrix<f64>, RiccatiError> {
    let dual = Regulator { a: &a.transpose(), b: &c.transpose(), q: w, r: v, n: None };
    Ok(dlqr(&dual)?.k.transpose())
}
