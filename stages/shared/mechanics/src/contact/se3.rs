//! Exponential and logarithm of rigid motions (SCIENCE B2, in place of (3.31)).
//!
//! The rigs and the controllers use `hat` alone yet: the reference vectors and the tests of this crate use the rest.

use nalgebra::{Matrix3, Matrix4, Rotation3, UnitQuaternion, Vector3};

/// A twist: velocity `v` of the origin and angular velocity `w`, or what they do in a unit of time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Twist {
    /// m/s.
    pub v: Vector3<f64>,
    /// rad/s.
    pub w: Vector3<f64>,
}

/// The matrix of `a x`.
pub fn hat(a: &Vector3<f64>) -> Matrix3<f64> {
    a.cross_matrix()
}

/// `exp(X s)`: the motion that the twist makes in `s` seconds.
pub fn exp(twist: &Twist, s: f64) -> Matrix4<f64> {
    let mut x = Matrix4::zeros();
    x.fixed_view_mut::<3, 3>(0, 0).copy_from(&hat(&twist.w));
    x.fixed_view_mut::<3, 1>(0, 3).copy_from(&twist.v);
    let n = twist.w.norm();
    let theta = n * s;
    let square = theta * theta;
    let (a, b) = if theta.abs() < 1e-4 {
        (s * s * (0.5 - square / 24.0), s * s * s * (1.0 / 6.0 - square / 120.0))
    } else {
        ((1.0 - libm::cos(theta)) / (n * n), (theta - libm::sin(theta)) / (n * n * n))
    };
    let x2 = x * x;
    Matrix4::identity() + x * s + x2 * a + x2 * x * b
}

/// The twist that makes a motion in one second, turning by at most half a turn. The motion's upper left block must be a
/// rotation.
pub fn log(motion: &Matrix4<f64>) -> Twist {
    let rotation = motion.fixed_view::<3, 3>(0, 0).into_owned();
    let place = motion.fixed_view::<3, 1>(0, 3).into_owned();
    let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    // Of the two quaternions of a rotation, the one that turns less.
    let (scalar, vector) = if turn.w < 0.0 { (-turn.w, -turn.imag()) } else { (turn.w, turn.imag()) };
    let sine = vector.norm();
    let theta = 2.0 * libm::atan2(sine, scalar);
    let w = if sine < 1e-12 { vector * 2.0 } else { vector * (theta / sine) };
    // V^-1 of v: 1 - w/2 + (1 - (theta/2) cot(theta/2)) / theta^2 w^2.
    let square = theta * theta;
    let second =
        if theta < 1e-3 { 1.0 / 12.0 + square / 720.0 } else { (1.0 - 0.5 * theta * scalar / sine) / square };
    let cross = w.cross(&place);
    Twist { v: place - cross * 0.5 + w.cross(&cross) * second, w }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_logarithm_undoes_the_exponential(
            v in prop::array::uniform3(-1.0..1.0f64),
            direction in prop::array::uniform3(-1.0..1.0f64),
            angle in prop_oneof![0.0..1e-6f64, 0.0..3.1f64, 3.1..3.139f64],
        ) {
            let direction = Vector3::from(direction);
            prop_assume!(direction.norm() > 0.1);
            let twist = Twist { v: v.into(), w: direction.normalize() * angle };
            let found = log(&exp(&twist, 1.0));
            prop_assert!((found.v - twist.v).amax() < 1e-8 && (found.w - twist.w).amax() < 1e-8, "{:?}", found);
        }

        #[test]
        fn times_add_up(
            v in prop::array::uniform3(-1.0..1.0f64),
            w in prop::array::uniform3(-2.0..2.0f64),
            s in -1.0..1.0f64,
            t in -1.0..1.0f64,
        ) {
            let twist = Twist { v: v.into(), w: w.into() };
            let whole = exp(&twist, s + t);
            prop_assert!((exp(&twist, s) * exp(&twist, t) - whole).amax() < 1e-12);
        }
    }
}
