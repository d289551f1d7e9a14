//! The Lyapunov equation P A + A^T P = -Q (4.34).
//!
//! No controller uses this module: the reference vectors and the tests of this crate do. In the adaptive law's rates P is
//! the identity (SCIENCE Y1).

use nalgebra::{DMatrix, DVector};

/// Why there is no P.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LyapunovError {
    /// Matrices that are not square, not alike, empty, or have numbers that are none.
    #[error("A and Q must be square, of one size from 1, and finite")]
    Shape,
    /// A has an eigenvalue that does not lie to the left, or Q is not positive: P is not positive, and adaptation by it
    /// runs away.
    #[error(
        "P is not positive definite: every eigenvalue of A must have a negative real part, and Q be positive definite"
    )]
    NotPositive,
}

/// Solves P A + A^T P = -Q for the positive definite P, as one linear system of n^2 equations. For small n.
///
/// # Errors
/// [`LyapunovError`].
pub fn lyapunov(a: &DMatrix<f64>, q: &DMatrix<f64>) -> Result<DMatrix<f64>, LyapunovError> {
    let n = a.nrows();
    let finite = a.iter().chain(q.iter()).all(|v| v.is_finite());
    if n == 0 || !a.is_square() || q.shape() != a.shape() || !finite {
        return Err(LyapunovError::Shape);
    }
    let identity = DMatrix::<f64>::identity(n, n);
    // Column by column, vec(P A) = (A^T x I) vec(P) and vec(A^T P) = (I x A^T) vec(P).
    let system = a.transpose().kronecker(&identity) + identity.kronecker(&a.transpose());
    let right = DVector::from_iterator(n * n, q.iter().map(|v| -v));
    let solved = system.lu().solve(&right).ok_or(LyapunovError::NotPositive)?;
    let p = DMatrix::from_column_slice(n, n, solved.as_slice());
    let p = (&p + p.transpose()) * 0.5;
    // The printed P is negative definite: with it the gains grow without end (SCIENCE E6).
    if p.clone().cholesky().is_none() {
        return Err(LyapunovError::NotPositive);
    }
    Ok(p)
}
