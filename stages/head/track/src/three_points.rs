//! Three points on a head that move with it.
//!
//! The dissertation says only that it defines three points on the head (4.3.3). These are ours: the cloud is cut into
//! three sectors of 120 degrees about its centroid, in the plane of its two larger principal axes, and each sector's
//! centroid is a point. Nobody has to mark them, they turn with the cloud, and thousands of points stand behind each.
//! They shift where another part of the head comes into view, and a head's two larger axes are not very different:
//! those are the way's limits.

use nalgebra::{Matrix3, Rotation3, Vector3};

/// The three points and the axes that they were cut by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ThreePoints {
    /// Centroids of the three sectors, m.
    pub points: [Vector3<f64>; 3],
    /// The axes: that of the first sector, the one a quarter turn on, and their normal.
    pub axes: Rotation3<f64>,
}

/// The three points of a reference: finite points (m) seen from the origin. The first sector lies on the longest
/// principal axis, and the shortest one looks at the camera. `None` where a sector is empty.
#[must_use]
pub fn three_points(cloud: &[Vector3<f64>]) -> Option<ThreePoints> {
    let (mean, values, vectors) = principal_axes(cloud)?;
    let axis = |i: usize| -> Vector3<f64> { vectors.column(i).into_owned() };
    let (u, w) = (axis(values.imax()), axis(values.imin()));
    let w = if w.dot(&mean) > 0.0 { -w } else { w };
    cut(cloud, &mean, u, w)
}

/// The three points of a later cloud. Principal axes have no sign, and two of like length no order: each axis is the
/// one that is closest to that of `axes`. `None` where a sector is empty.
#[must_use]
pub fn same_three_points(cloud: &[Vector3<f64>], axes: &Rotation3<f64>) -> Option<ThreePoints> {
    let (mean, _, vectors) = principal_axes(cloud)?;
    // Each principal axis in those axes; the normal is chosen first.
    let among = axes.matrix().transpose() * vectors;
    let normal = among.row(2).transpose().iamax();
    let rest = [(normal + 1) % 3, (normal + 2) % 3];
    let along = if among[(0, rest[0])].abs() >= among[(0, rest[1])].abs() { rest[0] } else { rest[1] };
    let signed = |column: usize, axis: usize| -> Vector3<f64> {
        let sign = if among[(axis, column)] < 0.0 { -1.0 } else { 1.0 };
        vectors.column(column) * sign
    };
    cut(cloud, &mean, signed(along, 0), signed(normal, 2))
}

/// Mean, eigenvalues and eigenvectors of the covariance.
fn principal_axes(cloud: &[Vector3<f64>]) -> Option<(Vector3<f64>, Vector3<f64>, Matrix3<f64>)> {
    let n = cloud.len() as f64;
    let first = cloud.first()?;
    let (mut sum, mut squares) = (Vector3::zeros(), Matrix3::zeros());
    for point in cloud {
        let d = point - first;
        sum += d;
        squares += d * d.transpose();
    }
    let mean = sum / n;
    let eigen = (squares / n - mean * mean.transpose()).symmetric_eigen();
    Some((mean + first, eigen.eigenvalues, eigen.eigenvectors))
}

/// The centroids of the three sectors about the normal `w`, the first around `u`.
fn cut(cloud: &[Vector3<f64>], mean: &Vector3<f64>, u: Vector3<f64>, w: Vector3<f64>) -> Option<ThreePoints> {
    let v = w.cross(&u);
    let mut sums = [Vector3::zeros(); 3];
    let mut counts = [0.0_f64; 3];
    for point in cloud {
        let d = point - mean;
        let (a, b) = (d.dot(&u), d.dot(&v));
        // Sector 0 is within 60 degrees of u.
        let sector = if a > 0.0 && b * b <= 3.0 * a * a {
            0
        } else if b > 0.0 {
            1
        } else {
            2
        };
        sums[sector] += d;
        counts[sector] += 1.0;
    }
    if counts.contains(&0.0) {
        return None;
    }
    let axes = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[u, v, w]));
    Some(ThreePoints { points: [0, 1, 2].map(|i| mean + sums[i] / counts[i]), axes })
}
