//! Poses in samples and frames, as transforms, and as six numbers: the conversions that all stages share.
//!
//! - [`PoseNumbers`]: position, pitch, roll and yaw of a transform
//! - [`extrinsic`]: whether the measured place of a camera can be trusted
//! - the functions here: from samples and frames to transforms, and back. Positions are in metres, quaternions are
//!   `[w, x, y, z]`.

#![forbid(unsafe_code)]

pub mod extrinsic;
mod numbers;

pub use numbers::PoseNumbers;

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use stillpoint_operator::frames::Rigid;
use stillpoint_samples::PoseElement;

/// Squared norms that the quaternion of a rotation may have in a sample.
const UNIT: core::ops::Range<f64> = 0.99..1.01;

/// The transform of a position and a quaternion of any length but zero.
#[must_use]
pub fn isometry(position: [f64; 3], [w, x, y, z]: [f64; 4]) -> Isometry3<f64> {
    let turn = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
    Isometry3::from_parts(Translation3::from(position), turn)
}

/// The transform of a position and a quaternion; `None` where the quaternion is none of a rotation, such as zeros or NaN.
#[must_use]
pub fn checked_isometry(position: [f64; 3], orientation: [f64; 4]) -> Option<Isometry3<f64>> {
    let [w, x, y, z] = orientation;
    UNIT.contains(&Quaternion::new(w, x, y, z).norm_squared()).then(|| isometry(position, orientation))
}

/// Pitch, roll and yaw of a quaternion, rad; `None` where it is none of a rotation.
#[must_use]
pub fn angles(orientation: [f64; 4]) -> Option<[f64; 3]> {
    let numbers = PoseNumbers::of(&checked_isometry([0.0; 3], orientation)?);
    Some([numbers.pitch, numbers.roll, numbers.yaw])
}

/// The transform between two frames of a pipeline.
#[must_use]
pub fn of_frame(rigid: &Rigid) -> Isometry3<f64> {
    isometry(rigid.translation, rigid.quaternion())
}

/// The quaternion of a rotation as samples have it. Both signs are the same rotation; the first number is not negative.
#[must_use]
pub fn orientation(rotation: &UnitQuaternion<f64>) -> [f64; 4] {
    let q = rotation.quaternion();
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    [q.w, q.i, q.j, q.k].map(|c| sign * c)
}

/// The sample of a pose with its covariance (x, y, z, turns about x, y, z; row by row).
#[must_use]
pub fn element(pose: &Isometry3<f64>, covariance: [f64; 36]) -> PoseElement {
    PoseElement {
        position: pose.translation.vector.into(),
        orientation: orientation(&pose.rotation),
        covariance,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_pose_comes_back_from_its_sample_with_one_sign(
            position in prop::array::uniform3(-1.0..1.0_f64), turn in prop::array::uniform3(-3.0..3.0_f64),
        ) {
            let rotation = UnitQuaternion::from_scaled_axis(Vector3::from(turn));
            let pose = Isometry3::from_parts(Translation3::from(position), rotation);
            let sample = element(&pose, [0.0; 36]);
            prop_assert!(sample.orientation[0] >= 0.0);
            let back = checked_isometry(sample.position, sample.orientation).unwrap();
            prop_assert!((back.to_homogeneous() - pose.to_homogeneous()).norm() < 1e-14);
            let numbers = PoseNumbers::of(&pose);
            let found = angles(sample.orientation).unwrap();
            let due = [numbers.pitch, numbers.roll, numbers.yaw];
            prop_assert!(found.iter().zip(due).all(|(a, b)| (a - b).abs() < 1e-6));
        }
    }

    #[test]
    fn a_quaternion_that_is_no_rotation_has_no_transform() {
        for wrong in [[0.0; 4], [f64::NAN; 4], [1.0, 1.0, 0.0, 0.0], [f64::INFINITY, 0.0, 0.0, 0.0]] {
            assert_eq!((checked_isometry([0.0; 3], wrong), angles(wrong)), (None, None));
        }
    }
}
