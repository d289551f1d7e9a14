//! State of a constant-velocity filter in N channels: prediction (4.3)-(4.6) and update (4.7)-(4.9), SCIENCE D1-D2.
//!
//! The covariance is held in N x N blocks, position-position, position-velocity and velocity-velocity, which stand
//! for the 2N x 2N matrix [[pp, pv], [pv^T, vv]]. With F = [[I, dt I], [0, I]] and H = [I, 0] every product is one of blocks.
//! A pose is an error state about its mean: its rotations are small ones about the frame's axes, to first order in
//! velocity times dt.

use nalgebra::{SMatrix, SVector};

use crate::manifold::Manifold;
use crate::measurement::Measurement;
use crate::process::ProcessNoise;

/// Position and velocity with their joint covariance. Units are the measurement's (m and m/s for SI).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State<const N: usize, X = SVector<f64, N>> {
    pub position: X,
    /// Velocity, per second.
    pub velocity: SVector<f64, N>,
    /// Covariance of the position.
    pub pp: SMatrix<f64, N, N>,
    /// Covariance of position (rows) with velocity (columns).
    pub pv: SMatrix<f64, N, N>,
    /// Covariance of the velocity.
    pub vv: SMatrix<f64, N, N>,
}

/// What a measurement says beyond the prediction, and what it weighs. Channels that were not measured have no
/// residual, no gain, and their own unit in S.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Innovation<const N: usize> {
    /// nu = z - H x.
    pub residual: SVector<f64, N>,
    /// S = H P H^T + R.
    pub covariance: SMatrix<f64, N, N>,
    /// The rows of K for the position: K = P H^T S^-1.
    pub position_gain: SMatrix<f64, N, N>,
    /// The rows of K for the velocity, per second.
    pub velocity_gain: SMatrix<f64, N, N>,
    /// Which channels were measured.
    pub measured: [bool; N],
}

fn symmetric<const N: usize>(m: SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
    (m + m.transpose()) * 0.5
}

impl<const N: usize, X: Manifold<N>> State<N, X> {
    /// At rest at a measured position. Channels that were not measured have `open_sd`; the velocity is 0 with
    /// `velocity_sd`.
    #[must_use]
    pub fn at_rest(z: &Measurement<N, X>, open_sd: &SVector<f64, N>, velocity_sd: &SVector<f64, N>) -> Self {
        let measured = z.measured();
        let from_origin = z.position.minus(&X::origin());
        let at = SVector::from_fn(|i, _| if measured[i] { from_origin[i] } else { 0.0 });
        let pp = SMatrix::from_fn(|i, j| match (measured[i] && measured[j], i == j) {
            (true, _) => z.covariance[(i, j)],
            (false, true) => open_sd[i] * open_sd[i],
            (false, false) => 0.0,
        });
        Self {
            position: X::origin().plus(&at),
            velocity: SVector::zeros(),
            pp: symmetric(pp),
            pv: SMatrix::zeros(),
            vv: SMatrix::from_diagonal(&velocity_sd.component_mul(velocity_sd)),
        }
    }

    /// The state `dt` seconds later: x = F x, P = F P F^T + Q.
    #[must_use]
    pub fn predicted(&self, dt: f64, process: &ProcessNoise<N>) -> Self {
        let q = process.over(dt);
        Self {
            position: self.position.plus(&(self.velocity * dt)),
            velocity: self.velocity,
            pp: self.pp
                + (self.pv + self.pv.transpose()) * dt
                + self.vv * (dt * dt)
                + SMatrix::from_diagonal(&q.pp),
            pv: self.pv + self.vv * dt + SMatrix::from_diagonal(&q.pv),
            vv: self.vv + SMatrix::from_diagonal(&q.vv),
        }
    }

    /// The innovation of a measurement; `None` where S is not positive definite.
    #[must_use]
    pub fn innovation(&self, z: &Measurement<N, X>) -> Option<Innovation<N>> {
        let measured = z.measured();
        let difference = z.position.minus(&self.position);
        let residual = SVector::from_fn(|i, _| if measured[i] { difference[i] } else { 0.0 });
        let covariance =
            symmetric(SMatrix::<f64, N, N>::from_fn(|i, j| match (measured[i] && measured[j], i == j) {
                (true, _) => self.pp[(i, j)] + z.covariance[(i, j)],
                (false, true) => 1.0,
                (false, false) => 0.0,
            }));
        let inverse = covariance.cholesky()?.inverse();
        let gain = |rows: &SMatrix<f64, N, N>| {
            // H leaves out the columns of channels that were not measured.
            let seen = SMatrix::from_fn(|i, j| if measured[j] { rows[(i, j)] } else { 0.0 });
            seen * inverse
        };
        Some(Innovation {
            residual,
            covariance,
            position_gain: gain(&self.pp),
            velocity_gain: gain(&self.pv.transpose()),
            measured,
        })
    }

    /// The state after the measurement: x = x + K nu, and the Joseph form P = (I - K H) P (I - K H)^T + K R K^T,
    /// which keeps P positive semidefinite for any gain.
    #[must_use]
    pub fn updated(&self, innovation: &Innovation<N>, z: &Measurement<N, X>) -> Self {
        let (kp, kv) = (innovation.position_gain, innovation.velocity_gain);
        let measured = innovation.measured;
        let r = SMatrix::from_fn(|i, j| if measured[i] && measured[j] { z.covariance[(i, j)] } else { 0.0 });
        let a = SMatrix::<f64, N, N>::identity() - kp;
        let kv_pv = kv * self.pv;
        Self {
            position: self.position.plus(&(kp * innovation.residual)),
            velocity: self.velocity + kv * innovation.residual,
            pp: symmetric(a * self.pp * a.transpose() + kp * r * kp.transpose()),
            pv: a * self.pv - a * self.pp * kv.transpose() + kp * r * kv.transpose(),
            vv: symmetric(
                kv * self.pp * kv.transpose() - kv_pv - kv_pv.transpose() + self.vv + kv * r * kv.transpose(),
            ),
        }
    }

    /// Whether all numbers are finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        let matrices = [&self.pp, &self.pv, &self.vv];
        let mean = self.position.minus(&X::origin());
        mean.iter().chain(&self.velocity).all(|v| v.is_finite())
            && matrices.iter().all(|m| m.iter().all(|v| v.is_finite()))
    }
}

impl<const N: usize> Innovation<N> {
    /// Whether nu_i^2 / S_ii exceeds `gate` in any channel.
    #[must_use]
    pub fn exceeds(&self, gate: f64) -> bool {
        (0..N).any(|i| self.residual[i] * self.residual[i] > gate * self.covariance[(i, i)])
    }
}
