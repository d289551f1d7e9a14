//! A pose as six numbers: where the head is, and its pitch, roll and yaw.
//!
//! Axes as IEC 61217 names those of the table top: x to the left of a patient who lies supine, head first; y towards
//! the head end; z up. Pitch is the turn about x, roll about y, yaw about z, each right-handed about the couch's
//! fixed axes, first pitch, then roll, then yaw:
//!
//! ```text
//! R = Rz(yaw) Ry(roll) Rx(pitch)
//! ```
//!
//! That is the order of `frames:`, too. (The dissertation's frame is left-handed and its order is not stated, SCIENCE
//! E1.)

use core::f64::consts::FRAC_PI_2;

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// A pose as six numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseNumbers {
    /// Position of the head's origin, m.
    pub position: [f64; 3],
    /// Turn about x, rad, from -pi to pi.
    pub pitch: f64,
    /// Turn about y, rad, from -pi/2 to pi/2.
    pub roll: f64,
    /// Turn about z, rad, from -pi to pi.
    pub yaw: f64,
}

impl PoseNumbers {
    /// The numbers of `couch_from_head`. At a roll of 90 degrees pitch and yaw are one turn: it is called yaw.
    #[must_use]
    pub fn of(pose: &Isometry3<f64>) -> Self {
        let r = pose.rotation.to_rotation_matrix().into_inner();
        let across = libm::hypot(r[(0, 0)], r[(1, 0)]);
        let (pitch, roll, yaw) = if across > 1e-12 {
            let pitch = libm::atan2(r[(2, 1)], r[(2, 2)]);
            (pitch, libm::atan2(-r[(2, 0)], across), libm::atan2(r[(1, 0)], r[(0, 0)]))
        } else {
            let roll = if r[(2, 0)] < 0.0 { FRAC_PI_2 } else { -FRAC_PI_2 };
            (0.0, roll, libm::atan2(-r[(0, 1)], r[(1, 1)]))
        };
        Self { position: pose.translation.vector.into(), pitch, roll, yaw }
    }

    /// The pose with these numbers.
    #[must_use]
    pub fn pose(&self) -> Isometry3<f64> {
        let [(sx, cx), (sy, cy), (sz, cz)] =
            [self.pitch, self.roll, self.yaw].map(|a| (libm::sin(a), libm::cos(a)));
        #[rustfmt::skip]
        let r = Matrix3::new(
            cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx,
            sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx,
            -sy,     cy * sx,                cy * cx,
        );
        let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(r));
        Isometry3::from_parts(Translation3::from(Vector3::from(self.position)), turn)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn each_angle_turns_about_its_own_axis_right_handed() {
        let zero = PoseNumbers { position: [0.0; 3], pitch: 0.0, roll: 0.0, yaw: 0.0 };
        let quarter = FRAC_PI_2;
        let image = |numbers: PoseNumbers, axis: Vector3<f64>| numbers.pose() * axis;
        let close = |a: Vector3<f64>, b: Vector3<f64>| assert!((a - b).norm() < 1e-15, "{a} {b}");
        close(image(PoseNumbers { pitch: quarter, ..zero }, Vector3::y()), Vector3::z());
        close(image(PoseNumbers { roll: quarter, ..zero }, Vector3::z()), Vector3::x());
        close(image(PoseNumbers { yaw: quarter, ..zero }, Vector3::x()), Vector3::y());
    }

    #[test]
    fn pitch_comes_first_then_roll_then_yaw() {
        let turn = |axis, angle| UnitQuaternion::from_axis_angle(&axis, angle);
        let (x, y, z) = (Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis());
        let pose = Isometry3::from_parts(
            Translation3::new(1.0, 2.0, 3.0),
            turn(z, 0.3) * turn(y, -0.2) * turn(x, 0.1),
        );
        let numbers = PoseNumbers::of(&pose);
        assert_eq!(numbers.position, [1.0, 2.0, 3.0]);
        for (found, expected) in [(numbers.pitch, 0.1), (numbers.roll, -0.2), (numbers.yaw, 0.3)] {
            assert!((found - expected).abs() < 1e-15, "{numbers:?}");
        }
    }

    #[test]
    fn at_a_roll_of_90_degrees_the_pose_is_kept() {
        for roll in [FRAC_PI_2, -FRAC_PI_2] {
            let pose = PoseNumbers { position: [0.0; 3], pitch: 0.4, roll, yaw: -0.7 }.pose();
            let numbers = PoseNumbers::of(&pose);
            assert!(numbers.pose().rotation.angle_to(&pose.rotation) < 1e-7, "{numbers:?}");
        }
    }

    proptest! {
        #[test]
        fn pose_and_numbers_are_each_other(
            position in prop::array::uniform3(-2.0..2.0f64),
            pitch in -3.1..3.1f64, roll in -1.5..1.5f64, yaw in -3.1..3.1f64,
        ) {
            let numbers = PoseNumbers { position, pitch, roll, yaw };
            let back = PoseNumbers::of(&numbers.pose());
            prop_assert!((back.pitch - pitch).abs() < 1e-12, "{back:?}");
            prop_assert!((back.roll - roll).abs() < 1e-12, "{back:?}");
            prop_assert!((back.yaw - yaw).abs() < 1e-12, "{back:?}");
            prop_assert_eq!(back.position, position);
        }
    }
}
