//! A flat plate at two distances: the unit of the depth, and how flat the plate is measured.

use nalgebra::{Matrix3, Vector3};

use super::error::ExtrinsicError;
use super::still::Still;

/// Part of the image's width and height that the plate must fill.
const MIDDLE: f64 = 0.5;
/// Share of the points that must be on one plane.
const SHARE: f64 = 0.8;
/// Distance within which a point is on the plane, as a part of its depth.
const ON_PLANE: f64 = 0.01;
/// Largest turn between the images, rad.
const TURN: f64 = 0.017_453_292_519_943_295;
/// Largest tilt of the plate, degrees: a way along its normal is then that along the axis but for 0.14 %.
const TILT_DEG: f64 = 3.0;

/// What two images of a plate say.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthScale {
    /// Measured over given change of the distance, less 1.
    pub scale: f64,
    /// Measured change of the distance along the axis of the camera, m.
    pub moved: f64,
    /// Where the axis of the camera meets the two plates, m.
    pub distances: [f64; 2],
    /// Root of the mean square of the distances of the points from the two planes, m.
    pub rms: [f64; 2],
    /// Mean of these distances at the edge of the middle less that in its centre, m: a bowl is a wrong lens model.
    pub bowl: [f64; 2],
    /// Angles between normals of the plates and the axis of the camera, rad.
    pub tilts: [f64; 2],
    /// Turn between the images, rad.
    pub turn: f64,
}

struct Plate {
    normal: Vector3<f64>,
    /// Along the axis of the camera, m.
    distance: f64,
    rms: f64,
    bowl: f64,
}

/// Compares images of a plate that was moved along the axis of the camera by a known way, m, away from it.
///
/// # Errors
/// No plate fills the middle of an image, it is tilted or turned, or it came nearer.
pub fn depth_scale(near: &Still, far: &Still, moved: f64) -> Result<DepthScale, ExtrinsicError> {
    let (a, b) = (plate(near, "first")?, plate(far, "second")?);
    let turn = libm::acos(a.normal.dot(&b.normal).clamp(-1.0, 1.0));
    if turn > TURN {
        return Err(ExtrinsicError::Turned { tilt_deg: turn.to_degrees() });
    }
    let tilts = [a.normal, b.normal].map(|normal| libm::acos(normal.z.min(1.0)));
    for (which, tilt) in ["first", "second"].into_iter().zip(tilts) {
        let tilt_deg = tilt.to_degrees();
        if tilt_deg > TILT_DEG {
            return Err(ExtrinsicError::Tilted { which, tilt_deg, most_deg: TILT_DEG });
        }
    }
    let measured = b.distance - a.distance;
    if measured <= 0.0 {
        return Err(ExtrinsicError::Exchanged { by_mm: -1e3 * measured });
    }
    Ok(DepthScale {
        scale: measured / moved - 1.0,
        moved: measured,
        distances: [a.distance, b.distance],
        rms: [a.rms, b.rms],
        bowl: [a.bowl, b.bowl],
        tilts,
        turn,
    })
}

fn plate(still: &Still, which: &'static str) -> Result<Plate, ExtrinsicError> {
    let (width, height) = (still.width as f64, still.height() as f64);
    // From 0 in the middle of the image to 1 at the edge of the part that counts.
    let outwards = |pixel: usize| {
        let (column, row) = ((pixel % still.width) as f64 + 0.5, (pixel / still.width) as f64 + 0.5);
        let [x, y] = [column / width - 0.5, row / height - 0.5].map(|part| part.abs() / (0.5 * MIDDLE));
        x.max(y)
    };
    let all: Vec<(f64, Vector3<f64>)> = still
        .points
        .iter()
        .enumerate()
        .filter_map(|(pixel, point)| Some((outwards(pixel), (*point)?)))
        .filter(|(out, _)| *out <= 1.0)
        .collect();
    let pixels = (MIDDLE * MIDDLE * still.points.len() as f64).max(1.0);
    let mut on: Vec<(f64, Vector3<f64>)> = all.clone();
    let mut plate = Plate { normal: Vector3::z(), distance: 0.0, rms: 0.0, bowl: 0.0 };
    for _ in 0..4 {
        let share = on.len() as f64 / pixels;
        if share < SHARE {
            return Err(ExtrinsicError::NoPlate { which, share: 100.0 * share });
        }
        let count = on.len() as f64;
        let mean = on.iter().map(|(_, point)| point).sum::<Vector3<f64>>() / count;
        let scatter: Matrix3<f64> =
            on.iter().map(|(_, point)| (point - mean) * (point - mean).transpose()).sum();
        let eigen = scatter.symmetric_eigen();
        let normal: Vector3<f64> = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
        let normal = if normal.z < 0.0 { -normal } else { normal };
        let off = |point: &Vector3<f64>| normal.dot(&(point - mean));
        let of = |range: std::ops::Range<f64>| {
            let (mut sum, mut count) = (0.0, 0.0);
            for (_, point) in on.iter().filter(|(out, _)| range.contains(out)) {
                sum += off(point);
                count += 1.0;
            }
            sum / f64::max(count, 1.0)
        };
        let rms = (on.iter().map(|(_, point)| off(point) * off(point)).sum::<f64>() / count).sqrt();
        plate =
            Plate { normal, distance: normal.dot(&mean) / normal.z, rms, bowl: of(0.8..1.1) - of(0.0..0.3) };
        on = all.iter().filter(|(_, point)| off(point).abs() < ON_PLANE * point.z).copied().collect();
    }
    Ok(plate)
}
