//! How far a cloud is from the surface.

use nalgebra::{Isometry3, Matrix3, Vector3};

use crate::surface::Surface;

/// Mean distance of at most `points` points of the cloud from the surface, each at most `cap` (m): what a start is
/// chosen by.
#[must_use]
pub fn misfit(
    surface: &Surface,
    cloud: &[Vector3<f64>],
    pose: &Isometry3<f64>,
    cap: f64,
    points: usize,
) -> f64 {
    let rotation: Matrix3<f64> = pose.rotation.to_rotation_matrix().into_inner();
    let (mut sum, mut used) = (0.0, 0.0);
    for point in spread(cloud, points) {
        let at = rotation * point + pose.translation.vector;
        if surface.is_neck(&at) {
            continue;
        }
        sum += surface.partner(&at).map_or(cap, |partner| {
            let lateral = if partner.over { 0.0 } else { partner.sightline.aside };
            (partner.sightline.distance * partner.sightline.distance + lateral).sqrt().min(cap)
        });
        used += 1.0;
    }
    if used > 0.0 { sum / used } else { cap }
}

/// At most `most` elements, spread evenly.
pub(super) fn spread(cloud: &[Vector3<f64>], most: usize) -> impl Iterator<Item = &Vector3<f64>> {
    let count = cloud.len().min(most);
    (0..count).map(move |k| &cloud[k * cloud.len() / count])
}
