//! The plane of the couch's top.

use nalgebra::Vector3;

use super::super::still::Still;
use super::error::EdgeError;
use crate::plane::Plane;

/// Part of the image's width and height in its middle that the couch fills.
const MIDDLE: f64 = 1.0 / 3.0;
/// Least share of its pixels that are on the plane.
const SHARE: f64 = 0.6;
/// Distance within which a point is on the plane: in rms, and at least in m.
const ON: (f64, f64) = (4.0, 2e-3);
/// Distance from which a point is on no plane, m.
const FARTHEST: f64 = 12e-3;
/// Patches along a side of the middle.
const PATCHES: usize = 4;

/// The plane of the couch's top in the camera's frame.
pub(super) struct Top {
    pub plane: Plane,
    /// Root of the mean square of the distances of points from it, m.
    pub rms: f64,
    pub points: usize,
    /// Distance within which a point is on it, m.
    pub near: f64,
}

impl Top {
    /// Height of a point over the plane, m.
    pub fn height(&self, point: &Vector3<f64>) -> f64 {
        self.plane.normal.dot(point) + self.plane.offset
    }
}

pub(super) fn top(still: &Still) -> Result<Top, EdgeError> {
    let (width, height) = (still.width as f64, still.height() as f64);
    // From -1 to 1 over the middle of the image.
    let parts = |pixel: usize| {
        let (x, y) = ((pixel % still.width) as f64 / width, (pixel / still.width) as f64 / height);
        [x, y].map(|part| (part - 0.5) / (0.5 * MIDDLE))
    };
    let is_middle = |pixel: &usize| parts(*pixel).iter().all(|part| part.abs() < 1.0);
    let pixels = (0..still.points.len()).filter(is_middle).count().max(1);
    let middle: Vec<(usize, Vector3<f64>)> = (0..still.points.len())
        .filter(is_middle)
        .filter_map(|pixel| {
            let [column, row] = parts(pixel).map(|part| (0.5 * (part + 1.0) * PATCHES as f64) as usize);
            Some((row * PATCHES + column, still.points[pixel]?))
        })
        .collect();
    let points: Vec<Vector3<f64>> = middle.iter().map(|(_, point)| *point).collect();
    let on = |top: &Top| points.iter().filter(|point| top.height(point).abs() < FARTHEST).count();
    // The plane of one of the patches: an edge of the couch crosses a few of them at most.
    let patch = |patch: usize| {
        let own: Vec<Vector3<f64>> =
            middle.iter().filter(|(of, _)| *of == patch).map(|(_, point)| *point).collect();
        fitted(&own, None, FARTHEST)
    };
    let start = (0..PATCHES * PATCHES).filter_map(patch).max_by_key(on);
    let share = start.as_ref().map_or(0.0, |top| on(top) as f64 / pixels as f64);
    let mut top = match start {
        Some(top) if share >= SHARE => top,
        _ => return Err(EdgeError::NoPlane { share: 100.0 * share }),
    };
    for _ in 0..3 {
        let near = top.near;
        top = fitted(&points, Some(&top), near.max(0.5 * FARTHEST)).unwrap_or(top);
    }
    let all: Vec<Vector3<f64>> = still.points.iter().flatten().copied().collect();
    for _ in 0..3 {
        let near = top.near;
        top = fitted(&all, Some(&top), near).unwrap_or(top);
    }
    Ok(top)
}

/// The plane of the points that are near to one before.
fn fitted(points: &[Vector3<f64>], before: Option<&Top>, near: f64) -> Option<Top> {
    let is_on = |point: &&Vector3<f64>| before.is_none_or(|top| top.height(point).abs() < near);
    let on = || points.iter().filter(is_on);
    let plane = Plane::fit(on().map(|point| [point.x as f32, point.y as f32, point.z as f32]))?;
    let count = on().count();
    let off = |point: &Vector3<f64>| plane.normal.dot(point) + plane.offset;
    let rms = (on().map(|point| off(point) * off(point)).sum::<f64>() / count as f64).sqrt();
    Some(Top { plane, rms, points: count, near: (ON.0 * rms).clamp(ON.1, FARTHEST) })
}
