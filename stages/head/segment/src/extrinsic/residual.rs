//! The error of a place, as a pipeline file states it: what balls and couch show of it, brought up to a head.
//!
//! Three balls cannot show all of it. Nine coordinates are given and six determine the place, so three distances are left;
//! an error of the heights moves and turns the place and leaves no residual. The couch shows it. Where the couch is not
//! compared, the error that stated places of balls have counts instead.

use nalgebra::{Matrix3, Vector3};

use super::surface::SurfaceCheck;
use super::targets::Targets;

/// Height of a head over the couch, m.
pub(super) const HEAD_M: f64 = 0.15;
/// One standard deviation of the stated place of a ball on each axis, m.
const STATED_M: f64 = 0.5e-3;

/// Parts of the error of a place, m. They are added, since nothing says that they differ in direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parts {
    /// The largest distance of a ball from its place.
    pub balls: f64,
    /// Mean height of the couch, without sign.
    pub height: f64,
    /// Tilt of the couch times the height of a head.
    pub tilt: f64,
    /// Scale of the distances times the reach: from the middle of the balls to the farthest of them, a head high.
    pub scale: f64,
    /// Without the couch: how far the middle of a head is moved by one standard deviation of the stated places.
    pub stated: f64,
}

impl Parts {
    pub(super) fn of(balls: f64, scale: f64, surface: Option<&SurfaceCheck>, targets: &Targets) -> Self {
        let count = targets.balls().len() as f64;
        let middle = targets.balls().iter().map(|ball| ball.at).sum::<Vector3<f64>>() / count;
        let offs: Vec<Vector3<f64>> = targets.balls().iter().map(|ball| ball.at - middle).collect();
        let farthest = offs.iter().map(|off| off.norm()).fold(0.0, f64::max);
        Self {
            balls,
            height: surface.map_or(0.0, |surface| surface.height.abs()),
            tilt: surface.map_or(0.0, |surface| surface.tilt * HEAD_M),
            scale: scale.abs() * libm::hypot(farthest, HEAD_M),
            stated: if surface.is_some() { 0.0 } else { moved(&offs, HEAD_M - middle.z) },
        }
    }

    /// The error, m.
    pub fn sum(&self) -> f64 {
        self.balls + self.height + self.tilt + self.scale + self.stated
    }
}

/// How far a place at this height over the middle of the balls is moved, root of the mean square, by independent errors of
/// their stated places. By least squares, the covariance of a small turn is the inverse of the sum of `|q|^2 - q q^T`.
fn moved(offs: &[Vector3<f64>], height: f64) -> f64 {
    let inertia: Matrix3<f64> =
        offs.iter().map(|q| Matrix3::from_diagonal_element(q.norm_squared()) - q * q.transpose()).sum();
    let Some(turn) = inertia.try_inverse() else { return f64::INFINITY };
    let lever = Vector3::new(0.0, 0.0, height).cross_matrix();
    let covariance = Matrix3::identity() / offs.len() as f64 + lever * turn * lever.transpose();
    STATED_M * covariance.trace().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stated_places_move_a_head_by_their_error_and_by_the_turn_that_they_allow() {
        let square =
            [[0.1, 0.1], [-0.1, 0.1], [0.1, -0.1], [-0.1, -0.1]].map(|[x, y]| Vector3::new(x, y, 0.0));
        // Between four balls: three axes, each with half of the error of one.
        assert!((moved(&square, 0.0) / (STATED_M * 0.75_f64.sqrt()) - 1.0).abs() < 1e-12);
        // A turn about x or y has a variance of 1 over the sum of y^2 or x^2, 0.04 m^2, and moves by the height.
        let expected = STATED_M * (0.75_f64 + 2.0 * 0.01 / 0.04).sqrt();
        assert!((moved(&square, 0.1) / expected - 1.0).abs() < 1e-12);
        assert_eq!(moved(&[Vector3::x() * 0.1, Vector3::x() * -0.1], 0.1), f64::INFINITY);
    }
}
