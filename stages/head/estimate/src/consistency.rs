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

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, Vector2};

    #[test]
    fn both_are_the_squared_length_in_units_of_the_covariance() {
        // The inverse of [[4, 2], [2, 3]] is [[3, -2], [-2, 4]] / 8.
        let (e, p) = (Vector2::new(1.0, -2.0), Matrix2::new(4.0, 2.0, 2.0, 3.0));
        let due = (3.0 + 8.0 + 16.0) / 8.0;
        assert!((nees(&e, &p).unwrap() - due).abs() < 1e-12);
        let innovation = Innovation {
            residual: e,
            covariance: p,
            measured: [true; 2],
            position_gain: SMatrix::zeros(),
            velocity_gain: SMatrix::zeros(),
        };
        assert!((nis(&innovation).unwrap() - due).abs() < 1e-12);
        assert_eq!(nees(&e, &Matrix2::new(1.0, 2.0, 2.0, 1.0)), None);
    }
}
