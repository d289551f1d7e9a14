//! The rigid transform from board to camera, its covariance, and the focal length that the corners have.

use nalgebra::{
    Isometry3, Matrix2x3, Matrix3, Matrix6, Rotation3, SMatrix, SVector, Translation3, UnitQuaternion,
    Vector2, Vector3,
};

/// Steps of the least squares at most.
const STEPS: usize = 50;
/// A step shorter than this, in m and rad, is the last one.
const STILL: f64 = 1e-12;

/// Focal lengths and principal point of a camera without distortion, px; the middle of the first pixel is 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// Focal length along a row.
    pub fx: f64,
    /// Focal length along a column.
    pub fy: f64,
    /// Column of the principal point.
    pub cx: f64,
    /// Row of the principal point.
    pub cy: f64,
}

/// A board as the camera sees it.
#[derive(Clone, Debug)]
pub(super) struct Pose {
    pub camera_from_board: Isometry3<f64>,
    /// Found less expected place of each corner, px.
    pub residuals: Vec<Vector2<f64>>,
    /// Covariance of turn (about the axes of the camera, through the board's middle) and place, rad and m.
    pub covariance: Matrix6<f64>,
    /// Focal length that fits best over the given one, less 1, and its standard deviation.
    pub focal: (f64, f64),
    /// Whether another tilt fits nearly as well.
    pub twofold: bool,
}

impl Lens {
    fn project(&self, point: &Vector3<f64>) -> Vector2<f64> {
        Vector2::new(self.fx * point.x / point.z + self.cx, self.fy * point.y / point.z + self.cy)
    }

    fn slope(&self, point: &Vector3<f64>) -> Matrix2x3<f64> {
        let (x, y) = (self.fx / point.z, self.fy / point.z);
        Matrix2x3::new(x, 0.0, -x * point.x / point.z, 0.0, y, -y * point.y / point.z)
    }
}

/// The pose of a plane whose points (m) are seen at places (px), by least squares of their distances in the image.
pub(super) fn pose(lens: &Lens, points: &[Vector3<f64>], seen: &[Vector2<f64>]) -> Option<Pose> {
    let start = by_homography(lens, points, seen)?;
    let (best, sum) = fitted(lens, points, seen, start)?;
    // Seen from afar, a plane that is tilted to the other side looks much the same.
    let (other, other_sum) = match fitted(lens, points, seen, tilted_back(&best)) {
        Some(other) => other,
        None => (best, f64::INFINITY),
    };
    let is_other = other.rotation.angle_to(&best.rotation) > 1e-3;
    let (least, most) = (sum.min(other_sum), sum.max(other_sum));
    let camera_from_board = if other_sum < sum { other } else { best };
    let freedom = (2 * seen.len()).saturating_sub(6).max(1) as f64;
    let variance = least / freedom;
    let (normal, _) = equations::<6>(lens, points, seen, &camera_from_board, 1.0);
    let covariance = normal.try_inverse()? * variance;
    let residual = |(point, seen): (&Vector3<f64>, &Vector2<f64>)| {
        seen - lens.project(&(camera_from_board * nalgebra::Point3::from(*point)).coords)
    };
    Some(Pose {
        camera_from_board,
        residuals: points.iter().zip(seen).map(residual).collect(),
        covariance,
        focal: focal(lens, points, seen, &camera_from_board),
        twofold: is_other && most < 4.0 * least,
    })
}

/// The pose from the homography of the plane (Zhang, PAMI 22 (2000) 1330).
fn by_homography(lens: &Lens, points: &[Vector3<f64>], seen: &[Vector2<f64>]) -> Option<Isometry3<f64>> {
    let size = points.iter().map(|point| point.norm()).fold(0.0, f64::max);
    let mut sums = SMatrix::<f64, 9, 9>::zeros();
    for (point, seen) in points.iter().zip(seen) {
        let (x, y) = (point.x / size, point.y / size);
        let (u, v) = ((seen.x - lens.cx) / lens.fx, (seen.y - lens.cy) / lens.fy);
        let rows = [
            SVector::<f64, 9>::from([x, y, 1.0, 0.0, 0.0, 0.0, -u * x, -u * y, -u]),
            SVector::<f64, 9>::from([0.0, 0.0, 0.0, x, y, 1.0, -v * x, -v * y, -v]),
        ];
        sums += rows.iter().map(|row| row * row.transpose()).sum::<SMatrix<f64, 9, 9>>();
    }
    if sums.iter().any(|sum| !sum.is_finite()) {
        return None;
    }
    let eigen = sums.symmetric_eigen();
    let least = eigen.eigenvectors.column(eigen.eigenvalues.imin());
    let part = |column: usize| Vector3::new(least[column], least[3 + column], least[6 + column]);
    let (first, second, middle) = (part(0) / size, part(1) / size, part(2));
    // The board is in front of the camera.
    let scale = middle.z.signum() / (first.norm() * second.norm()).sqrt();
    let (first, second, middle) = (first * scale, second * scale, middle * scale);
    let svd = Matrix3::from_columns(&[first, second, first.cross(&second)]).svd(true, true);
    let rotation = Rotation3::from_matrix_unchecked(svd.u? * svd.v_t?);
    let rotation = UnitQuaternion::from_rotation_matrix(&rotation);
    middle.iter().all(|part| part.is_finite()).then(|| Isometry3::from_parts(middle.into(), rotation))
}

/// The pose with the board's normal mirrored at the line of sight.
fn tilted_back(pose: &Isometry3<f64>) -> Isometry3<f64> {
    let line = pose.translation.vector.normalize();
    let normal = pose.rotation * Vector3::z();
    let mirrored = line * (2.0 * line.dot(&normal)) - normal;
    let turn = UnitQuaternion::rotation_between(&normal, &mirrored).unwrap_or_default();
    Isometry3::from_parts(pose.translation, turn * pose.rotation)
}

/// The pose of least squares from a start, by Levenberg and Marquardt, and the sum of squares, px^2.
fn fitted(
    lens: &Lens,
    points: &[Vector3<f64>],
    seen: &[Vector2<f64>],
    start: Isometry3<f64>,
) -> Option<(Isometry3<f64>, f64)> {
    let mut pose = start;
    let mut sum = squares(lens, points, seen, &pose)?;
    let mut damping = 1e-3;
    for _ in 0..STEPS {
        let (normal, right) = equations::<6>(lens, points, seen, &pose, 1.0);
        let damped = normal + Matrix6::from_diagonal(&(normal.diagonal() * damping));
        let step = damped.try_inverse()? * right;
        let next = moved(&pose, &step.fixed_rows::<3>(0).into(), &step.fixed_rows::<3>(3).into());
        match squares(lens, points, seen, &next) {
            Some(less) if less <= sum => {
                (pose, sum, damping) = (next, less, damping * 0.1);
                if step.norm() < STILL {
                    break;
                }
            }
            _ => damping *= 10.0,
        }
    }
    Some((pose, sum))
}

/// A pose turned about the middle of the board and shifted.
fn moved(pose: &Isometry3<f64>, turn: &Vector3<f64>, by: &Vector3<f64>) -> Isometry3<f64> {
    let rotation = UnitQuaternion::from_scaled_axis(*turn) * pose.rotation;
    Isometry3::from_parts(Translation3::from(pose.translation.vector + by), rotation)
}

/// The sum of squares, px^2; `None` if a corner is behind the camera.
fn squares(
    lens: &Lens,
    points: &[Vector3<f64>],
    seen: &[Vector2<f64>],
    pose: &Isometry3<f64>,
) -> Option<f64> {
    let mut sum = 0.0;
    for (point, seen) in points.iter().zip(seen) {
        let point = (pose * nalgebra::Point3::from(*point)).coords;
        if point.z <= 0.0 {
            return None;
        }
        sum += (lens.project(&point) - seen).norm_squared();
    }
    sum.is_finite().then_some(sum)
}

/// Normal equations of turn, place and, as a seventh unknown, the focal length as a part of the given one.
fn equations<const N: usize>(
    lens: &Lens,
    points: &[Vector3<f64>],
    seen: &[Vector2<f64>],
    pose: &Isometry3<f64>,
    focal: f64,
) -> (SMatrix<f64, N, N>, SVector<f64, N>) {
    let lens = Lens { fx: lens.fx * focal, fy: lens.fy * focal, ..*lens };
    let (mut normal, mut right) = (SMatrix::<f64, N, N>::zeros(), SVector::<f64, N>::zeros());
    for (point, seen) in points.iter().zip(seen) {
        let lever = pose.rotation * point;
        let at = lever + pose.translation.vector;
        let slope = lens.slope(&at);
        let turns = -slope * lever.cross_matrix();
        let expected = lens.project(&at);
        let lengths = (expected - Vector2::new(lens.cx, lens.cy)) / focal;
        let off = seen - expected;
        for row in 0..2 {
            let one = SVector::<f64, N>::from_fn(|column, _| match column {
                0..3 => turns[(row, column)],
                3..6 => slope[(row, column - 3)],
                _ => lengths[row],
            });
            normal += one * one.transpose();
            right += one * off[row];
        }
    }
    (normal, right)
}

/// The focal length that fits best over the given one, less 1, and its standard deviation; that is infinite where a board that
/// faces the camera has any focal length.
fn focal(lens: &Lens, points: &[Vector3<f64>], seen: &[Vector2<f64>], start: &Isometry3<f64>) -> (f64, f64) {
    const OPEN: (f64, f64) = (0.0, f64::INFINITY);
    let (mut pose, mut focal, mut spread) = (*start, 1.0, 0.0);
    for _ in 0..8 {
        let (normal, right) = equations::<7>(lens, points, seen, &pose, focal);
        let Some(inverse) = normal.try_inverse() else { return OPEN };
        let step = inverse * right;
        (focal, spread) = (focal + step[6], inverse[(6, 6)]);
        if !(0.2..5.0).contains(&focal) {
            return OPEN;
        }
        pose = moved(&pose, &step.fixed_rows::<3>(0).into(), &step.fixed_rows::<3>(3).into());
    }
    let longer = Lens { fx: lens.fx * focal, fy: lens.fy * focal, ..*lens };
    let freedom = (2 * seen.len()).saturating_sub(7).max(1) as f64;
    match squares(&longer, points, seen, &pose) {
        Some(sum) => (focal - 1.0, (spread * sum / freedom).sqrt()),
        None => OPEN,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane() -> Vec<Vector3<f64>> {
        let at = |place: usize| Vector3::new((place / 8) as f64 - 5.0, (place % 8) as f64 - 3.5, 0.0) * 0.025;
        (0..88).map(at).collect()
    }

    fn seen(lens: &Lens, pose: &Isometry3<f64>) -> Vec<Vector2<f64>> {
        plane().iter().map(|point| lens.project(&(pose * nalgebra::Point3::from(*point)).coords)).collect()
    }

    #[test]
    fn exact_corners_give_the_exact_pose_and_focal_length() {
        let lens = Lens { fx: 566.0, fy: 560.0, cx: 319.5, cy: 239.5 };
        for (tilt, turn) in [(0.6, 0.1), (-0.9, 2.0), (0.2, -1.0)] {
            let tilted = UnitQuaternion::from_euler_angles(std::f64::consts::PI + tilt, 0.1, turn);
            let truth = Isometry3::from_parts(Translation3::new(0.05, -0.02, 0.7), tilted);
            let found = pose(&lens, &plane(), &seen(&lens, &truth)).unwrap();
            assert!((found.camera_from_board.translation.vector - truth.translation.vector).norm() < 1e-9);
            assert!(found.camera_from_board.rotation.angle_to(&truth.rotation) < 1e-9);
            assert!(!found.twofold && found.residuals.iter().all(|off| off.norm() < 1e-8), "{found:?}");
            // Corners of a camera with focal lengths that are 1 % longer.
            let longer = Lens { fx: 1.01 * lens.fx, fy: 1.01 * lens.fy, ..lens };
            let found = pose(&lens, &plane(), &seen(&longer, &truth)).unwrap();
            assert!((found.focal.0 - 0.01).abs() < 1e-6, "{tilt} {found:?}");
        }
    }

    #[test]
    fn the_covariance_is_that_of_noisy_corners() {
        let lens = Lens { fx: 366.0, fy: 366.0, cx: 255.5, cy: 211.5 };
        let rotation = UnitQuaternion::from_euler_angles(std::f64::consts::PI + 0.7, 0.0, 0.3);
        let truth = Isometry3::from_parts(Translation3::new(0.0, 0.03, 0.75), rotation);
        let exact = seen(&lens, &truth);
        // A fixed sequence with the standard deviation 0.05 px.
        let mut state = 1_u64;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        let mut noise = || 0.05 * 12_f64.sqrt() * uniform();
        let (mut turns, mut places, mut expected) = (Matrix3::zeros(), Matrix3::zeros(), Matrix6::zeros());
        let trials = 300;
        for _ in 0..trials {
            let noisy: Vec<_> = exact.iter().map(|at| at + Vector2::new(noise(), noise())).collect();
            let found = pose(&lens, &plane(), &noisy).unwrap();
            let turn = (found.camera_from_board.rotation * truth.rotation.inverse()).scaled_axis();
            let off = found.camera_from_board.translation.vector - truth.translation.vector;
            turns += turn * turn.transpose() / f64::from(trials);
            places += off * off.transpose() / f64::from(trials);
            expected += found.covariance / f64::from(trials);
        }
        for axis in 0..3 {
            let ratios = [
                turns[(axis, axis)] / expected[(axis, axis)],
                places[(axis, axis)] / expected[(axis + 3, axis + 3)],
            ];
            assert!(ratios.iter().all(|ratio| (0.7..1.4).contains(ratio)), "{axis}: {ratios:?}");
        }
    }
}
