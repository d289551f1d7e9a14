//! State of a constant-velocity filter in N channels: prediction (4.3)-(4.6) and update (4.7)-(4.9), SCIENCE D1-D2.
//!
//! The covariance is held in N x N blocks, position-position, position-velocity and velocity-velocity, which stand
//! for the 2N x 2N matrix [[pp, pv], [pv^T, vv]]. With F = [[I, dt I], [0, I]] and H = [I, 0] every product is one of blocks.

use nalgebra::{SMatrix, SVector};

/// Position and velocity with their joint covariance. Units are the measurement's (m and m/s for SI).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State<const N: usize> {
    /// Position.
    pub position: SVector<f64, N>,
    /// Velocity, per second.
    pub velocity: SVector<f64, N>,
    /// Covariance of the position.
    pub pp: SMatrix<f64, N, N>,
    /// Covariance of position (rows) with velocity (columns).
    pub pv: SMatrix<f64, N, N>,
    /// Covariance of the velocity.
    pub vv: SMatrix<f64, N, N>,
}

/// What a measurement says beyond the prediction, and what it weighs.
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
}

fn symmetric<const N: usize>(m: SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
    (m + m.transpose()) * 0.5
}

impl<const N: usize> State<N> {
    /// At rest at a measured position: velocity 0 with standard deviation `velocity_sd` in each channel.
    #[must_use]
    pub fn at_rest(position: SVector<f64, N>, covariance: SMatrix<f64, N, N>, velocity_sd: f64) -> Self {
        let variance = velocity_sd * velocity_sd;
        Self {
            position,
            velocity: SVector::zeros(),
            pp: covariance,
            pv: SMatrix::zeros(),
            vv: SMatrix::from_diagonal_element(variance),
        }
    }

    /// The state `dt` seconds later: x = F x, P = F P F^T + Q, Q = sigma_a^2 W W^T, W = (dt^2 / 2, dt) in each channel.
    #[must_use]
    pub fn predicted(&self, dt: f64, acceleration_sd: f64) -> Self {
        let identity = SMatrix::<f64, N, N>::identity();
        let q = acceleration_sd * acceleration_sd;
        let (w_position, w_velocity) = (0.5 * dt * dt, dt);
        Self {
            position: self.position + self.velocity * dt,
            velocity: self.velocity,
            pp: self.pp
                + (self.pv + self.pv.transpose()) * dt
                + self.vv * (dt * dt)
                + identity * (q * w_position * w_position),
            pv: self.pv + self.vv * dt + identity * (q * w_position * w_velocity),
            vv: self.vv + identity * (q * w_velocity * w_velocity),
        }
    }

    /// The innovation of a measured position with covariance `r`; `None` where S is not positive definite.
    #[must_use]
    pub fn innovation(&self, z: &SVector<f64, N>, r: &SMatrix<f64, N, N>) -> Option<Innovation<N>> {
        let covariance = symmetric(self.pp + r);
        let inverse = covariance.cholesky()?.inverse();
        Some(Innovation {
            residual: z - self.position,
            covariance,
            position_gain: self.pp * inverse,
            velocity_gain: self.pv.transpose() * inverse,
        })
    }

    /// The state after the measurement: x = x + K nu, and the Joseph form P = (I - K H) P (I - K H)^T + K R K^T,
    /// which keeps P positive semidefinite for any gain.
    #[must_use]
    pub fn updated(&self, innovation: &Innovation<N>, r: &SMatrix<f64, N, N>) -> Self {
        let (kp, kv) = (innovation.position_gain, innovation.velocity_gain);
        let a = SMatrix::<f64, N, N>::identity() - kp;
        let kv_pv = kv * self.pv;
        Self {
            position: self.position + kp * innovation.residual,
            velocity: self.velocity + kv * innovation.residual,
            pp: symmetric(a * self.pp * a.transpose() + kp * r * kp.transpose()),
            pv: a * self.pv - a * self.pp * kv.transpose() + kp * r * kv.transpose(),
            vv: symmetric(
                kv * self.pp * kv.transpose() - kv_pv - kv_pv.transpose() + self.vv + kv * r * kv.transpose(),
            ),
        }
    }
}
