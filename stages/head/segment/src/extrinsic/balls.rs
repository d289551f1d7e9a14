//! Balls of a known radius in a still image.
//!
//! Each pixel votes for the place one radius behind its surface, along the normal: the votes of a ball meet in its centre,
//! those of a plane are spread (a Hough transform, as in `ball.rs` for heads, but with a known radius). The best places are
//! refined by least squares of the depths along the rays, since that is where the noise of a depth camera is.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Matrix4, Vector3, Vector4};

use super::still::Still;

/// Width of a cell of the votes, in radii.
const CELL: f64 = 0.2;
/// Half of the base over which a normal is taken, in radii.
const BASE: f64 = 0.25;
/// Places that are refined at most.
const PLACES: usize = 24;
/// Least share of the pixels of a ball that a place needs in votes, and a ball in points.
const LEAST_SHARE: f64 = 0.3;
/// Fewest points of a ball.
const LEAST_POINTS: usize = 60;
/// Points count where the cosine between ray and normal is at least this: beyond, edges mix depths.
const LEAST_COSINE: f64 = 0.4;
/// Steps of the refinement.
const STEPS: usize = 20;
/// Largest deviation of the radius that the points have, in radii.
const RADIUS: f64 = 0.08;
/// Largest rms of a ball's points, in radii and at least in m.
const RMS: (f64, f64) = (0.03, 0.002);

/// A ball in the camera's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FoundBall {
    /// Its centre, m.
    pub centre: Vector3<f64>,
    /// Radius that was looked for, m.
    pub radius: f64,
    /// Radius that its points have, m.
    pub free_radius: f64,
    /// Its points.
    pub points: usize,
    /// Root of the mean square of the depths' residuals, m.
    pub rms: f64,
}

/// All balls of a radius, m, those of most points first.
pub(super) fn find(still: &Still, radius: f64) -> Vec<FoundBall> {
    let mut found: Vec<FoundBall> = Vec::new();
    for start in places(still, radius) {
        let Some(ball) = refined(still, start, radius) else { continue };
        if found.iter().all(|other| (other.centre - ball.centre).norm() > radius) {
            found.push(ball);
        }
    }
    found.sort_by_key(|ball| std::cmp::Reverse(ball.points));
    found
}

/// Pixels of a whole ball at a distance.
fn pixels(still: &Still, radius: f64, distance: f64) -> f64 {
    let across = radius / (distance * still.pixel_rad);
    std::f64::consts::PI * across * across
}

/// Places with many votes, the fullest first.
fn places(still: &Still, radius: f64) -> Vec<Vector3<f64>> {
    let cell = CELL * radius;
    let mut votes: BTreeMap<[i32; 3], (u32, Vector3<f64>)> = BTreeMap::new();
    for row in 0..still.height() {
        for column in 0..still.width {
            if let Some(centre) = centre_behind(still, column, row, radius) {
                let key = [0, 1, 2].map(|axis| (centre[axis] / cell).floor() as i32);
                let (count, sum) = votes.entry(key).or_insert((0, Vector3::zeros()));
                *count += 1;
                *sum += centre;
            }
        }
    }
    let around = |key: &[i32; 3]| {
        let (mut count, mut sum) = (0, Vector3::zeros());
        for x in -1..=1 {
            for y in -1..=1 {
                for z in -1..=1 {
                    if let Some((more, centres)) = votes.get(&[key[0] + x, key[1] + y, key[2] + z]) {
                        count += more;
                        sum += centres;
                    }
                }
            }
        }
        (count, sum / f64::from(count.max(1)))
    };
    let mut full: Vec<(u32, Vector3<f64>)> = votes.keys().map(around).collect();
    full.retain(|(count, centre)| f64::from(*count) >= LEAST_SHARE * pixels(still, radius, centre.norm()));
    // The sort is stable, so equal counts keep the order of the cells.
    full.sort_by_key(|(count, _)| std::cmp::Reverse(*count));
    let mut chosen: Vec<Vector3<f64>> = Vec::new();
    for (_, centre) in full {
        if chosen.len() < PLACES && chosen.iter().all(|other| (other - centre).norm() > 0.5 * radius) {
            chosen.push(centre);
        }
    }
    chosen
}

/// The place one radius behind the surface of a pixel.
fn centre_behind(still: &Still, column: usize, row: usize, radius: f64) -> Option<Vector3<f64>> {
    let point = still.at(column, row)?;
    let step = ((BASE * radius / (point.z * still.pixel_rad)).round() as usize).clamp(1, still.width);
    let is_inside =
        column >= step && row >= step && column + step < still.width && row + step < still.height();
    if !is_inside {
        return None;
    }
    let across = still.at(column + step, row)? - still.at(column - step, row)?;
    let down = still.at(column, row + step)? - still.at(column, row - step)?;
    if across.norm() > radius || down.norm() > radius {
        return None;
    }
    let normal = across.cross(&down).try_normalize(1e-12)?;
    // x right and y down: their cross product looks away from the camera.
    Some(point + radius * normal)
}

/// A ball's points: directions of rays, distances along them.
struct Seen {
    rays: Vec<(Vector3<f64>, f64)>,
    residuals: Vec<f64>,
}

/// Depth of a ball along a ray, with half of the chord; `None` where the ray misses it.
fn meets(ray: &Vector3<f64>, centre: &Vector3<f64>, radius: f64) -> Option<(f64, f64)> {
    let along = ray.dot(centre);
    let half = along * along - centre.norm_squared() + radius * radius;
    (half > 0.0).then(|| (along - half.sqrt(), half.sqrt()))
}

/// The points that belong to a ball within a tolerance.
fn seen(still: &Still, centre: &Vector3<f64>, radius: f64, tolerance: f64) -> Seen {
    let mut seen = Seen { rays: Vec::new(), residuals: Vec::new() };
    for point in still.points.iter().flatten() {
        if (point - centre).norm_squared() > (1.3 * radius + tolerance) * (1.3 * radius + tolerance) {
            continue;
        }
        let distance = point.norm();
        let ray = point / distance;
        if let Some((depth, half)) = meets(&ray, centre, radius)
            && half >= LEAST_COSINE * radius
            && (distance - depth).abs() < tolerance
        {
            seen.rays.push((ray, distance));
            seen.residuals.push(distance - depth);
        }
    }
    seen
}

/// The ball nearest to a place.
fn refined(still: &Still, start: Vector3<f64>, radius: f64) -> Option<FoundBall> {
    let mut centre = start;
    let mut tolerance = 0.3 * radius;
    for _ in 0..STEPS {
        let seen = seen(still, &centre, radius, tolerance);
        if seen.rays.len() < LEAST_POINTS {
            return None;
        }
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for ((ray, _), residual) in seen.rays.iter().zip(&seen.residuals) {
            let Some((slope, weight)) = slope(ray, &centre, radius) else { continue };
            normal += weight * slope * slope.transpose();
            right += weight * slope * *residual;
        }
        let step = normal.try_inverse()? * right;
        centre += step;
        if !centre.norm().is_finite() || (centre - start).norm() > radius {
            return None;
        }
        tolerance = (5.0 * median(&seen.residuals)).clamp(0.5e-3, 0.3 * radius);
        if step.norm() < 1e-8 {
            break;
        }
    }
    let last = seen(still, &centre, radius, tolerance);
    let points = last.rays.len();
    // The pixels within the cosine, of a whole ball.
    let whole = (1.0 - LEAST_COSINE * LEAST_COSINE) * pixels(still, radius, centre.norm());
    let rms = (last.residuals.iter().map(|r| r * r).sum::<f64>() / points.max(1) as f64).sqrt();
    let free_radius = free_radius(&last, &centre, radius)?;
    let is_ball = points >= LEAST_POINTS
        && points as f64 >= LEAST_SHARE * whole
        && (free_radius / radius - 1.0).abs() < RADIUS
        && rms < (RMS.0 * radius).max(RMS.1);
    is_ball.then_some(FoundBall { centre, radius, free_radius, points, rms })
}

/// Change of a ray's depth with the centre, and the weight of the ray: less where it grazes.
fn slope(ray: &Vector3<f64>, centre: &Vector3<f64>, radius: f64) -> Option<(Vector3<f64>, f64)> {
    let (_, half) = meets(ray, centre, radius)?;
    let cosine = half / radius;
    Some((ray - (ray * ray.dot(centre) - centre) / half, cosine * cosine))
}

/// The radius that these points have if it is free.
fn free_radius(seen: &Seen, centre: &Vector3<f64>, radius: f64) -> Option<f64> {
    let (mut centre, mut radius) = (*centre, radius);
    for _ in 0..3 {
        let (mut normal, mut right) = (Matrix4::zeros(), Vector4::zeros());
        for (ray, distance) in &seen.rays {
            let (Some((depth, half)), Some((part, weight))) =
                (meets(ray, &centre, radius), slope(ray, &centre, radius))
            else {
                continue;
            };
            let slope = Vector4::new(part.x, part.y, part.z, -radius / half);
            normal += weight * slope * slope.transpose();
            right += weight * slope * (distance - depth);
        }
        let step = normal.try_inverse()? * right;
        centre += step.xyz();
        radius += step.w;
    }
    (radius.is_finite() && radius > 0.0).then_some(radius)
}

/// Median of the magnitudes.
fn median(values: &[f64]) -> f64 {
    let mut magnitudes: Vec<f64> = values.iter().map(|value| value.abs()).collect();
    magnitudes.sort_by(f64::total_cmp);
    magnitudes.get(magnitudes.len() / 2).copied().unwrap_or(0.0)
}
