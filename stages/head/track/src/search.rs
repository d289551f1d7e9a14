//! Where an alignment may start: near the last pose, or anywhere after a loss.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use crate::align::{AlignParams, Aligner, Approach, Effort, Robust, misfit};
use crate::surface::Surface;

/// Turns about each axis that are tried after a loss, degrees.
const TURNS: [f64; 5] = [-40.0, -20.0, 0.0, 20.0, 40.0];
/// Points by which starts are compared.
const POINTS: usize = 250;
/// A point this far off counts no more than one farther off, m.
const CAP: f64 = 0.02;
/// Starts that are followed after a loss.
const FOLLOWED: usize = 5;
/// What a followed start gets.
const ROUGH: Effort = Effort { points: 1000, iterations: 20, step: 0.1, scale: 0.01, robust: Robust::Huber };

/// The best of some starts for a cloud.
#[must_use]
pub fn best_start(
    surface: &Surface,
    cloud: &[Vector3<f64>],
    starts: impl IntoIterator<Item = Isometry3<f64>>,
) -> Option<Isometry3<f64>> {
    let cost = |start: Isometry3<f64>| (misfit(surface, cloud, &start, CAP, POINTS), start);
    starts.into_iter().map(cost).min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, start)| start)
}

/// The start that turns as `rotation` does and brings the cloud's centroid onto the reference's.
#[must_use]
pub fn onto_centroid(
    surface: &Surface,
    centroid: &Vector3<f64>,
    rotation: &UnitQuaternion<f64>,
) -> Isometry3<f64> {
    let to = surface.whole() - surface.centre();
    Isometry3::from_parts(Translation3::from(to - rotation * centroid), *rotation)
}

/// Looks for the cloud in all turns of up to 40 degrees about each axis, around each of `rotations` and with the
/// centroids on each other, and follows the best. It always has a result; whether it fits is for the caller to judge.
pub fn search(
    aligner: &mut Aligner,
    surface: &Surface,
    cloud: &[Vector3<f64>],
    centroid: &Vector3<f64>,
    rotations: &[UnitQuaternion<f64>],
    params: &AlignParams,
) -> Isometry3<f64> {
    let mut best: Vec<(f64, Isometry3<f64>)> = Vec::with_capacity(FOLLOWED + 1);
    for rotation in rotations {
        for turn in turns() {
            let start = onto_centroid(surface, centroid, &(turn * rotation));
            let cost = misfit(surface, cloud, &start, CAP, POINTS);
            let place = best.partition_point(|(c, _)| *c <= cost);
            best.insert(place, (cost, start));
            best.truncate(FOLLOWED);
        }
    }
    let follow =
        |start: Isometry3<f64>| -> Approach { aligner.approach(surface, cloud, &start, params, &ROUGH) };
    let ends: Vec<_> = best.into_iter().map(|(_, start)| start).map(follow).collect();
    let poses = ends.iter().map(|end| end.surface_from_cloud);
    best_start(surface, cloud, poses)
        .unwrap_or_else(|| onto_centroid(surface, centroid, &UnitQuaternion::identity()))
}

fn turns() -> impl Iterator<Item = UnitQuaternion<f64>> {
    let angles = || TURNS.into_iter().map(f64::to_radians);
    angles().flat_map(move |x| {
        angles().flat_map(move |y| angles().map(move |z| UnitQuaternion::from_euler_angles(x, y, z)))
    })
}
