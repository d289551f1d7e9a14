//! The pose between two sets of paired points, by the unit quaternion of their cross-covariance (Besl and McKay).
//!
//! (4.21)-(4.22), SCIENCE E1: Sigma = (1/N) sum (p - mu_p)(x - mu_x)^T, A = Sigma - Sigma^T,
//! Delta = (A_23, A_31, A_12), and the rotation is the eigenvector of the largest eigenvalue of
//!
//! ```text
//! Q = | tr Sigma   Delta^T                            |
//!     | Delta      Sigma + Sigma^T - tr(Sigma) I_3    |
//! ```

use nalgebra::{Isometry3, Matrix3, Matrix4, Quaternion, Translation3, UnitQuaternion, Vector3};
use thiserror::Error;

/// Two largest eigenvalues closer than this part of the points' spread are one: the rotation is then not determined.
const GAP_LEAST: f64 = 1e-9;

/// Why paired points give no pose.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum PairsError {
    /// The sets differ in size.
    #[error("{measured} measured points cannot be paired with {model} of the model")]
    Unpaired {
        /// Measured points.
        measured: usize,
        /// Points of the model.
        model: usize,
    },
    /// A pose needs three pairs.
    #[error("{found} pairs of points give no pose; it takes 3")]
    TooFew {
        /// Pairs given.
        found: usize,
    },
    /// A coordinate is not finite.
    #[error("the coordinates of pair {pair} are not finite")]
    NotFinite {
        /// Which pair.
        pair: usize,
    },
    /// The points lie on a line, or are so symmetrical that several rotations fit alike.
    #[error("several rotations fit alike (eigenvalue gap {gap:.3e} m2): the points are on a line")]
    Undetermined {
        /// Difference of the two largest eigenvalues, m2.
        gap: f64,
    },
}

/// The pose that brings one set of points onto another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairedPose {
    /// x = R p + t: maps measured points onto the model.
    pub model_from_measured: Isometry3<f64>,
    /// Difference of the two largest eigenvalues of Q, m2: how much better this rotation fits than any other.
    pub gap: f64,
    /// Root mean square of the distances that remain, m.
    pub rms: f64,
}

/// The pose that brings `measured` onto `model`, pair by pair (m), in the sense of least squares.
///
/// # Errors
/// Sets of different sizes, fewer than three pairs, numbers that are not finite, points on a line.
pub fn pose_of_pairs(measured: &[Vector3<f64>], model: &[Vector3<f64>]) -> Result<PairedPose, PairsError> {
    if measured.len() != model.len() {
        return Err(PairsError::Unpaired { measured: measured.len(), model: model.len() });
    }
    let pairs = measured.len();
    if pairs < 3 {
        return Err(PairsError::TooFew { found: pairs });
    }
    let finite = |v: &Vector3<f64>| v.iter().all(|c| c.is_finite());
    if let Some(pair) = (0..pairs).find(|&i| !finite(&measured[i]) || !finite(&model[i])) {
        return Err(PairsError::NotFinite { pair });
    }
    let n = pairs as f64;
    let mean = |set: &[Vector3<f64>]| set.iter().fold(Vector3::zeros(), |sum, p| sum + p) / n;
    let (mu_p, mu_x) = (mean(measured), mean(model));
    let (mut sigma, mut spread) = (Matrix3::zeros(), 0.0);
    for (p, x) in measured.iter().zip(model) {
        sigma += (p - mu_p) * (x - mu_x).transpose() / n;
        spread += ((p - mu_p).norm_squared() + (x - mu_x).norm_squared()) / n;
    }
    let eigen = cross_covariance_form(&sigma).symmetric_eigen();
    let mut order = [0, 1, 2, 3];
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let gap = eigen.eigenvalues[order[0]] - eigen.eigenvalues[order[1]];
    // Written so that a gap that is no number is refused.
    let determined = gap > GAP_LEAST * spread;
    if !determined {
        return Err(PairsError::Undetermined { gap });
    }
    let q = eigen.eigenvectors.column(order[0]);
    let sign = if q[0] < 0.0 { -1.0 } else { 1.0 };
    let rotation = UnitQuaternion::new_normalize(Quaternion::new(q[0], q[1], q[2], q[3]) * sign);
    let model_from_measured = Isometry3::from_parts(Translation3::from(mu_x - rotation * mu_p), rotation);
    let left: f64 = measured
        .iter()
        .zip(model)
        .map(|(p, x)| (rotation * p + model_from_measured.translation.vector - x).norm_squared())
        .sum();
    Ok(PairedPose { model_from_measured, gap, rms: (left / n).sqrt() })
}

/// Q(Sigma) of (4.21).
fn cross_covariance_form(sigma: &Matrix3<f64>) -> Matrix4<f64> {
    let trace = sigma.trace();
    let skew = sigma - sigma.transpose();
    let delta = Vector3::new(skew[(1, 2)], skew[(2, 0)], skew[(0, 1)]);
    let mut q = Matrix4::zeros();
    q[(0, 0)] = trace;
    q.fixed_view_mut::<1, 3>(0, 1).copy_from(&delta.transpose());
    q.fixed_view_mut::<3, 1>(1, 0).copy_from(&delta);
    q.fixed_view_mut::<3, 3>(1, 1).copy_from(&(sigma + sigma.transpose() - Matrix3::identity() * trace));
    q
}
