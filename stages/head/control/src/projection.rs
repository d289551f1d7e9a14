//! Projection: adaptive gains that stay inside a ball, smoothly (SCIENCE E4).

use nalgebra::SVector;

/// A ball that gains stay in, with a shell in which growth is turned aside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ball {
    /// theta_max: the norm that gains never exceed.
    pub radius: f64,
    /// eps: the shell begins at `radius / sqrt(1 + eps)`.
    pub shell: f64,
}

/// The rate `update` of the gains `theta`, without the part of it that would leave the ball. With
/// `f = ((1 + eps) |theta|^2 - theta_max^2) / (eps theta_max^2)`, where f > 0 and grad f . v > 0, the rate is
/// `v - grad f (grad f . v) / |grad f|^2 f`.
#[must_use]
pub fn projected<const N: usize>(
    theta: &SVector<f64, N>,
    update: &SVector<f64, N>,
    ball: &Ball,
) -> SVector<f64, N> {
    let square = ball.radius * ball.radius;
    let f = ((1.0 + ball.shell) * theta.norm_squared() - square) / (ball.shell * square);
    let outward = theta.dot(update);
    // The gradient of f is a positive multiple of theta.
    if f > 0.0 && outward > 0.0 { update - theta * (outward / theta.norm_squared() * f) } else { *update }
}
