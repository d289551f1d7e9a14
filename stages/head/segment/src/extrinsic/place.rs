//! Which ball is which, and the rigid transform from camera to couch.

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::balls::{FoundBall, find};
use super::error::ExtrinsicError;
use super::residual::Parts;
use super::still::Still;
use super::surface::{SurfaceCheck, check};
use super::targets::{ALIKE_M, Targets};

/// Largest difference of a distance between balls of a match, m: less than exchanges change.
const MATCH_M: f64 = 0.5 * ALIKE_M;

/// How far measurements may be from what is given.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Largest distance of a ball from its place, m.
    pub residual: f64,
    /// Largest difference of the distances between balls in the mean, as a part of them, beyond their noise.
    pub scale: f64,
    /// Largest mean height of the couch beside the balls, m, and its tilt, rad; `None` leaves the couch out.
    pub surface: Option<(f64, f64)>,
}

impl Default for Limits {
    fn default() -> Self {
        Self { residual: 1e-3, scale: 3e-3, surface: Some((3e-3, 0.2_f64.to_radians())) }
    }
}

/// A camera over the couch.
#[derive(Clone, Debug, PartialEq)]
pub struct Placed {
    /// From the camera's frame (x right, y down, z forward) to the couch's.
    pub couch_from_camera: Isometry3<f64>,
    /// The balls, in the order of the targets.
    pub balls: Vec<FoundBall>,
    /// Distance of each ball from its place, m.
    pub residuals: Vec<f64>,
    /// Measured over given distance between balls, less 1, in the mean: a wrong depth unit or focal length.
    pub scale: f64,
    /// The couch beside the balls.
    pub surface: Option<SurfaceCheck>,
    /// The error of the place.
    pub error: Parts,
}

impl Placed {
    /// The largest distance of a ball from its place, m.
    pub fn residual(&self) -> f64 {
        self.residuals.iter().copied().fold(0.0, f64::max)
    }
}

/// Translation (m) and turns about the couch's fixed x, then y, then z axis (rad), as `frames:` writes a place.
pub fn at_and_rotation(couch_from_camera: &Isometry3<f64>) -> ([f64; 3], [f64; 3]) {
    let (x, y, z) = couch_from_camera.rotation.euler_angles();
    (couch_from_camera.translation.vector.into(), [x, y, z])
}

/// Finds the balls and places the camera.
///
/// # Errors
/// A ball is missing, distances or places do not match, or the couch is not at height 0.
pub fn place(still: &Still, targets: &Targets, limits: Limits) -> Result<Placed, ExtrinsicError> {
    let balls = matched(still, targets)?;
    let given: Vec<Vector3<f64>> = targets.balls().iter().map(|ball| ball.at).collect();
    let measured: Vec<Vector3<f64>> = balls.iter().map(|ball| ball.centre).collect();
    let couch_from_camera = rigid(&measured, &given);
    let highest = given.iter().map(|at| at.z).fold(f64::NEG_INFINITY, f64::max);
    let below = highest - couch_from_camera.translation.vector.z;
    if below > 0.0 {
        return Err(ExtrinsicError::Mirrored { below_mm: 1e3 * below });
    }
    let off = |(measured, given): (&Vector3<f64>, &Vector3<f64>)| {
        (couch_from_camera * nalgebra::Point3::from(*measured) - nalgebra::Point3::from(*given)).norm()
    };
    let (scale, sigma) = scale(&balls, &given);
    let most = limits.scale + 3.0 * sigma;
    if scale.abs() > most {
        return Err(ExtrinsicError::Scale { off: 100.0 * scale, most: 100.0 * most });
    }
    let residuals: Vec<f64> = measured.iter().zip(&given).map(off).collect();
    for (ball, off) in residuals.iter().enumerate() {
        if *off > limits.residual {
            let [off_mm, most_mm] = [*off, limits.residual].map(|m| 1e3 * m);
            return Err(ExtrinsicError::Residual { ball: ball + 1, off_mm, most_mm });
        }
    }
    let surface = match limits.surface {
        Some(limits) => Some(check(still, &couch_from_camera, targets, limits)?),
        None => None,
    };
    let largest = residuals.iter().copied().fold(0.0, f64::max);
    let error = Parts::of(largest, scale, surface.as_ref(), targets);
    Ok(Placed { couch_from_camera, balls, residuals, scale, surface, error })
}

/// The found ball of each target.
fn matched(still: &Still, targets: &Targets) -> Result<Vec<FoundBall>, ExtrinsicError> {
    let mut of_radius: Vec<(f64, Vec<FoundBall>)> = Vec::new();
    for ball in targets.balls() {
        let radius = 0.5 * ball.diameter;
        if of_radius.iter().all(|(known, _)| *known != radius) {
            of_radius.push((radius, find(still, radius)));
        }
    }
    let candidates: Vec<&Vec<FoundBall>> = targets
        .balls()
        .iter()
        .filter_map(|ball| of_radius.iter().find(|(radius, _)| *radius == 0.5 * ball.diameter))
        .map(|(_, found)| found)
        .collect();
    let mut best = Best::default();
    assign(&candidates, targets, &mut Vec::new(), 0.0, &mut best);
    match best.found {
        Some((off, balls)) => {
            // Another match that is nearly as good leaves it open.
            if best.second.is_some_and(|second| second < 3.0 * off + 1e-3) {
                return Err(ExtrinsicError::Ambiguous);
            }
            Ok(balls)
        }
        None => {
            let mut centres: Vec<Vector3<f64>> = Vec::new();
            for ball in of_radius.iter().flat_map(|(_, found)| found) {
                if centres.iter().all(|other| (other - ball.centre).norm() > ball.radius) {
                    centres.push(ball.centre);
                }
            }
            let at_mm = centres.iter().map(|centre| [0, 1, 2].map(|axis| 1e3 * centre[axis])).collect();
            let expected = targets.balls().len();
            let lacks = |(radius, found): &(f64, Vec<FoundBall>)| {
                found.len() < targets.balls().iter().filter(|ball| *radius == 0.5 * ball.diameter).count()
            };
            if centres.len() >= expected && !of_radius.iter().any(lacks) {
                return Err(ExtrinsicError::Distances { most_mm: 1e3 * MATCH_M, at_mm });
            }
            Err(ExtrinsicError::Missing { found: centres.len().min(expected - 1), expected, at_mm })
        }
    }
}

/// The best match, and how good the second is.
#[derive(Default)]
struct Best {
    found: Option<(f64, Vec<FoundBall>)>,
    second: Option<f64>,
}

/// Tries the assignments of found balls to targets; `worst` is the largest difference of a distance so far. What differs by
/// more than a match may is not followed: of many balls, there are too many assignments for that.
fn assign(
    candidates: &[&Vec<FoundBall>],
    targets: &Targets,
    chosen: &mut Vec<FoundBall>,
    worst: f64,
    best: &mut Best,
) {
    let given = targets.balls();
    let place = chosen.len();
    if place == given.len() {
        match &best.found {
            Some((known, _)) if *known <= worst => {
                best.second = Some(best.second.map_or(worst, |second| second.min(worst)));
            }
            known => {
                best.second = known.as_ref().map(|(known, _)| *known);
                best.found = Some((worst, chosen.clone()));
            }
        }
        return;
    }
    for ball in candidates[place] {
        let is_taken = chosen.iter().any(|other| (other.centre - ball.centre).norm() < 0.5 * ball.radius);
        if is_taken {
            continue;
        }
        let off = |(other, found): (usize, &FoundBall)| {
            ((found.centre - ball.centre).norm() - (given[other].at - given[place].at).norm()).abs()
        };
        let worst = chosen.iter().enumerate().map(off).fold(worst, f64::max);
        if worst > MATCH_M {
            continue;
        }
        chosen.push(*ball);
        assign(candidates, targets, chosen, worst, best);
        chosen.pop();
    }
}

/// The rigid transform of least squares (Kabsch, Acta Cryst. A 32 (1976) 922), never a reflection.
fn rigid(from: &[Vector3<f64>], to: &[Vector3<f64>]) -> Isometry3<f64> {
    let count = from.len() as f64;
    let mean = |points: &[Vector3<f64>]| points.iter().sum::<Vector3<f64>>() / count;
    let (a, b) = (mean(from), mean(to));
    let covariance: Matrix3<f64> = from.iter().zip(to).map(|(f, t)| (t - b) * (f - a).transpose()).sum();
    let svd = covariance.svd(true, true);
    let (Some(u), Some(v)) = (svd.u, svd.v_t) else { return Isometry3::identity() };
    let mut turn = Matrix3::identity();
    // The least singular value takes the sign that makes it a rotation.
    let least = svd.singular_values.imin();
    turn[(least, least)] = (u * v).determinant().signum();
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(u * turn * v));
    Isometry3::from_parts(Translation3::from(b - rotation * a), rotation)
}

/// Mean of measured over given distances, less 1, with its standard deviation by the noise of the depths, about.
fn scale(balls: &[FoundBall], given: &[Vector3<f64>]) -> (f64, f64) {
    let sum = |points: &[Vector3<f64>]| -> f64 {
        points.iter().enumerate().flat_map(|(i, a)| points[..i].iter().map(move |b| (a - b).norm())).sum()
    };
    let measured: Vec<Vector3<f64>> = balls.iter().map(|ball| ball.centre).collect();
    // A centre is about twice as uncertain across the rays as the mean of its depths is.
    let centre = balls.iter().map(|ball| 2.0 * ball.rms / (ball.points as f64).sqrt()).fold(0.0, f64::max);
    let pairs = 0.5 * (given.len() * (given.len() - 1)) as f64;
    let mean = sum(given) / pairs;
    (sum(&measured) / sum(given) - 1.0, std::f64::consts::SQRT_2 * centre / mean)
}
