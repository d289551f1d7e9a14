//! Fusion of two tracks of one motion (4.2.3, SCIENCE D3): the weight of the second track, and the fused state.
//!
//! Each rule gives a weight W; the fused state is x = x1 + W (x2 - x1). M is twice the number of channels N: positions,
//! then velocities.

use nalgebra::{SMatrix, SVector};

use crate::manifold::Manifold;
use crate::state::State;

/// The weight of the second track and the covariance of the fused one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Weighted<const M: usize> {
    /// W.
    pub weight: SMatrix<f64, M, M>,
    pub covariance: SMatrix<f64, M, M>,
}

fn symmetric<const M: usize>(m: SMatrix<f64, M, M>) -> SMatrix<f64, M, M> {
    (m + m.transpose()) * 0.5
}

/// The best weight for tracks whose errors have the cross covariance `p12`:
/// W = (P1 - P12)(P1 + P2 - P12 - P12^T)^-1, P = P1 - W (P1 - P12^T). `None` where the bracket, the covariance of the
/// tracks' difference, is not positive definite.
#[must_use]
pub fn cross_covariance<const M: usize>(
    p1: &SMatrix<f64, M, M>,
    p2: &SMatrix<f64, M, M>,
    p12: &SMatrix<f64, M, M>,
) -> Option<Weighted<M>> {
    let difference = symmetric(p1 + p2 - p12 - p12.transpose()).cholesky()?;
    // W S = A is S W^T = A^T, for S is symmetric.
    let weight = difference.solve(&(p1 - p12).transpose()).transpose();
    Some(Weighted { weight, covariance: symmetric(p1 - weight * (p1 - p12.transpose())) })
}

/// The weights as printed, P = (P1^-1 + P2^-1)^-1. They are right for independent errors, so the claimed covariance is
/// too small for tracks of one motion.
#[must_use]
pub fn inverse_variance<const M: usize>(
    p1: &SMatrix<f64, M, M>,
    p2: &SMatrix<f64, M, M>,
) -> Option<Weighted<M>> {
    cross_covariance(p1, p2, &SMatrix::zeros())
}

/// Covariance intersection, for tracks whose correlation is unknown: P^-1 = (1 - w) P1^-1 + w P2^-1 with the w that
/// minimises the determinant of P. For any correlation the claimed covariance is not too small.
#[must_use]
pub fn intersection<const M: usize>(p1: &SMatrix<f64, M, M>, p2: &SMatrix<f64, M, M>) -> Option<Weighted<M>> {
    let (i1, i2) = (p1.cholesky()?.inverse(), p2.cholesky()?.inverse());
    let information = |w: f64| symmetric(i1 * (1.0 - w) + i2 * w);
    // The logarithm of the determinant is concave in w, so a golden section finds its greatest value.
    let size = |w: f64| {
        let root = information(w).cholesky()?;
        Some((0..M).map(|i| libm::log(root.l_dirty()[(i, i)])).sum::<f64>())
    };
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..32 {
        let (a, b) = (high - GOLDEN * (high - low), low + GOLDEN * (high - low));
        if size(a)? > size(b)? {
            high = b;
        } else {
            low = a;
        }
    }
    // Where one track is better in all, it is taken alone.
    let inside = 0.5 * (low + high);
    let best = [0.0, 1.0]
        .into_iter()
        .try_fold(inside, |best, end| Some(if size(end)? >= size(best)? { end } else { best }))?;
    let covariance = information(best).cholesky()?.inverse();
    Some(Weighted { weight: covariance * i2 * best, covariance: symmetric(covariance) })
}

/// The covariance of (position, velocity) as one matrix.
#[must_use]
pub fn joint<const N: usize, const M: usize, X: Manifold<N>>(state: &State<N, X>) -> SMatrix<f64, M, M> {
    const { assert!(M == 2 * N, "M is twice N: positions, then velocities") };
    SMatrix::from_fn(|i, j| match (i < N, j < N) {
        (true, true) => state.pp[(i, j)],
        (true, false) => state.pv[(i, j - N)],
        (false, true) => state.pv[(j, i - N)],
        (false, false) => state.vv[(i - N, j - N)],
    })
}

/// The fused state of two tracks at one time.
#[must_use]
pub fn fused<const N: usize, const M: usize, X: Manifold<N>>(
    first: &State<N, X>,
    second: &State<N, X>,
    weighted: &Weighted<M>,
) -> State<N, X> {
    let (apart, faster) = (second.position.minus(&first.position), second.velocity - first.velocity);
    let difference = SVector::<f64, M>::from_fn(|i, _| if i < N { apart[i] } else { faster[i - N] });
    let step = weighted.weight * difference;
    let p = &weighted.covariance;
    State {
        position: first.position.plus(&SVector::from_fn(|i, _| step[i])),
        velocity: first.velocity + SVector::from_fn(|i, _| step[N + i]),
        pp: SMatrix::from_fn(|i, j| p[(i, j)]),
        pv: SMatrix::from_fn(|i, j| p[(i, N + j)]),
        vv: SMatrix::from_fn(|i, j| p[(N + i, N + j)]),
    }
}
