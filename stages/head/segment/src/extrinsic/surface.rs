//! The bare couch beside the balls: a check that no ball has a part in.

use nalgebra::{Isometry3, Point3, Vector3};

use super::error::ExtrinsicError;
use super::still::Still;
use super::targets::Targets;
use crate::plane::Plane;

/// Distance from height 0 within which points are the couch's, m.
const NEAR_M: f64 = 0.03;
/// Distance around the balls that is looked at, m.
const AROUND_M: f64 = 0.1;
/// Distance from a ball's centre within which points are left out, in radii.
const BALL: f64 = 1.5;
/// Fewest points.
const LEAST: usize = 500;

/// How the couch is measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceCheck {
    /// Mean height, m.
    pub height: f64,
    /// Angle to the plane of height 0, rad.
    pub tilt: f64,
    /// Root of the mean square of the distances from its own plane, m.
    pub rms: f64,
    /// Its points.
    pub points: usize,
}

/// Looks at the couch around the balls.
pub(super) fn check(
    still: &Still,
    couch_from_camera: &Isometry3<f64>,
    targets: &Targets,
    (most, most_tilt): (f64, f64),
) -> Result<SurfaceCheck, ExtrinsicError> {
    let bounds = [0, 1].map(|axis| {
        let places = || targets.balls().iter().map(|ball| ball.at[axis]);
        [
            places().fold(f64::INFINITY, f64::min) - AROUND_M,
            places().fold(f64::NEG_INFINITY, f64::max) + AROUND_M,
        ]
    });
    let is_couch = |point: &Vector3<f64>| {
        point.z.abs() < NEAR_M
            && (0..2).all(|axis| (bounds[axis][0]..bounds[axis][1]).contains(&point[axis]))
            && targets.balls().iter().all(|ball| {
                let off = point - ball.at;
                libm::hypot(off.x, off.y) > BALL * 0.5 * ball.diameter
            })
    };
    let mut points: Vec<Vector3<f64>> = still
        .points
        .iter()
        .flatten()
        .map(|point| (couch_from_camera * Point3::from(*point)).coords)
        .filter(is_couch)
        .collect();
    let mut found = SurfaceCheck { height: 0.0, tilt: 0.0, rms: 0.0, points: 0 };
    // The plane, and twice more without what is far from it.
    for _ in 0..3 {
        if points.len() < LEAST {
            return Err(ExtrinsicError::NoSurface { found: points.len(), least: LEAST });
        }
        let count = points.len();
        let mean = points.iter().sum::<Vector3<f64>>() / count as f64;
        let plane = Plane::fit(points.iter().map(|point| {
            let off = point - mean;
            [off.x as f32, off.y as f32, off.z as f32]
        }));
        let normal = plane.map_or(Vector3::z(), |plane| plane.normal);
        let off = |point: &Vector3<f64>| normal.dot(&(point - mean));
        let rms = (points.iter().map(|point| off(point) * off(point)).sum::<f64>() / count as f64).sqrt();
        let tilt = libm::acos(normal.z.abs().min(1.0));
        found = SurfaceCheck { height: mean.z, tilt, rms, points: count };
        points.retain(|point| off(point).abs() < (3.0 * rms).max(1e-4));
    }
    if found.height.abs() > most || found.tilt > most_tilt {
        return Err(ExtrinsicError::Surface {
            off_mm: 1e3 * found.height,
            tilt_deg: found.tilt.to_degrees(),
            most_mm: 1e3 * most,
            most_deg: most_tilt.to_degrees(),
        });
    }
    Ok(found)
}
