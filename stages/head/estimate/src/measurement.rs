//! A measured position with its covariance, some of whose channels may be open.

use nalgebra::{SMatrix, SVector};

use crate::manifold::Manifold;

/// A measured position. A channel of infinite variance was not measured, whatever its number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measurement<const N: usize, X = SVector<f64, N>> {
    pub position: X,
    /// R, symmetric.
    pub covariance: SMatrix<f64, N, N>,
}

impl<const N: usize, X: Manifold<N>> Measurement<N, X> {
    /// Which channels were measured.
    #[must_use]
    pub fn measured(&self) -> [bool; N] {
        std::array::from_fn(|i| self.covariance[(i, i)] != f64::INFINITY)
    }

    /// Whether a channel was measured, and the numbers of those that were are finite with a covariance that is positive
    /// definite.
    #[must_use]
    pub fn is_usable(&self) -> bool {
        let measured = self.measured();
        let value = self.position.minus(&X::origin());
        let finite = (0..N).all(|i| {
            !measured[i]
                || value[i].is_finite() && (0..N).all(|j| !measured[j] || self.covariance[(i, j)].is_finite())
        });
        let own = SMatrix::<f64, N, N>::from_fn(|i, j| match (measured[i] && measured[j], i == j) {
            (true, _) => self.covariance[(i, j)],
            (false, true) => 1.0,
            (false, false) => 0.0,
        });
        measured.contains(&true) && finite && own.cholesky().is_some()
    }
}
