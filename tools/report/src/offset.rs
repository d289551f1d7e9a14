//! The rigid offset between an estimate and the truth: an estimate has another place on the head, and other axes.

use nalgebra::{Isometry3, Quaternion, UnitQuaternion, Vector3};

/// The mean of the truth's pose as each estimate carries it, over pairs of truth and estimate in one frame (m): what to
/// put behind an estimate to compare it with the truth. `None` without pairs.
pub fn mean_offset(pairs: &[(Isometry3<f64>, Isometry3<f64>)]) -> Option<Isometry3<f64>> {
    let between = |(truth, estimate): &(Isometry3<f64>, Isometry3<f64>)| estimate.inverse() * truth;
    let one = between(pairs.first()?).rotation;
    let place = pairs.iter().map(|pair| between(pair).translation.vector).sum::<Vector3<f64>>();
    // The mean of quaternions of one sign: they are close to each other.
    let turn = pairs.iter().map(|pair| between(pair).rotation).fold(Quaternion::default(), |sum, q| {
        let sign = if q.coords.dot(&one.coords) < 0.0 { -1.0 } else { 1.0 };
        sum + q.into_inner() * sign
    });
    Some(Isometry3::from_parts((place / pairs.len() as f64).into(), UnitQuaternion::new_normalize(turn)))
}
