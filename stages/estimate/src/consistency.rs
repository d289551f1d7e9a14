//! NIS and NEES: whether the covariance of a filter is the covariance of its errors.
//!
//! Over many steps of a filter whose model holds, the mean of NIS is the number of measured channels, and the mean of
//! NEES the number of channels of the state.

use nalgebra::{SMatrix, SVector};

use crate::state::Innovation;

/// Normalised innovation squared, nu^T S^-1 nu; `None` if it is not finite.
#[must_use]
pub fn nis<const N: usize>(innovation: &Innovation<N>) -> Option<f64> {
    normalised(&innovation.residual, &innovation.covariance)
}

/// Normalised estimation error squared, e^T P^-1 e, of a position; `None` if it is not finite.
#[must_use]
pub fn nees<const N: usize>(error: &SVector<f64, N>, covariance: &SMatrix<f64, N, N>) -> Option<f64> {
    normalised(error, covariance)
}

fn normalised<const N: usize>(e: &SVector<f64, N>, p: &SMatrix<f64, N, N>) -> Option<f64> {
    let squared = e.dot(&p.cholesky()?.solve(e));
    squared.is_finite().then_some(squared)
}
