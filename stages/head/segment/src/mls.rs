//! Robust moving least squares (Rusu 2009, 6; dissertation 4.18-4.20): points moved onto the smooth surface that their
//! neighbours lie on.
//!
//! Distances are taken of the normalised cloud, whose bounding box has a diagonal of 1. Each point has a plane of
//! reference through its k nearest neighbours, found by sample consensus, so that points of another surface do not
//! tilt it. The point is projected onto it; there a polynomial of degree 2 in u and v, with the plane's axes and its
//! normal as Darboux frame, is fitted to the neighbours' heights n, and its value at the point is where the point
//! goes.

use crate::mlesac::below;
use crate::neighbours::Neighbours;
use crate::outliers::alpha;
use crate::plane::{Plane, vector};
use nalgebra::{Matrix6, Vector3, Vector6};
use rand::Rng;

/// How points are smoothed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MlsParams {
    /// Neighbours of a point.
    pub neighbours: usize,
    /// k of (4.18): standard deviations over the mean of the neighbours' mean distances.
    pub deviations: f64,
    /// Distance within which a neighbour belongs to the plane of reference, in metres.
    pub tolerance: f64,
    /// Width of the cells that neighbours are looked for in, in metres: about the distance of points.
    pub cell: f64,
}

/// Planes drawn for a plane of reference.
const DRAWS: usize = 12;
/// Neighbours that a polynomial of degree 2 needs at least: more than its coefficients.
const NEEDED: usize = 9;

/// The smoothing with its buffers; after the first frames of a size it allocates nothing.
#[derive(Debug, Clone, Default)]
pub struct MovingLeastSquares {
    neighbours: Neighbours,
    found: Vec<(f32, u32)>,
    around: Vec<[f32; 3]>,
    smooth: Vec<[f32; 3]>,
    alpha: f64,
}

impl MovingLeastSquares {
    /// A smoothing without buffers.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Moves `points` (finite, in metres) onto the surface that they approximate, in their order. A point with too few
    /// neighbours for a polynomial stays where it is.
    pub fn smooth(&mut self, points: &[[f32; 3]], params: &MlsParams, rng: &mut impl Rng) -> &[[f32; 3]] {
        self.neighbours.sort(points, params.cell);
        let diagonal = diagonal(points);
        self.find_alpha(points, params, diagonal);
        self.smooth.clear();
        for (number, &point) in points.iter().enumerate() {
            self.neighbours.nearest(points, number, params.neighbours, &mut self.found);
            self.around.clear();
            self.around.push(point);
            self.around.extend(self.found.iter().map(|&(_, other)| points[other as usize]));
            let reference = reference_plane(&self.around, params.tolerance, rng);
            let moved = reference.and_then(|plane| {
                onto_surface(point, &plane, &self.around, params.tolerance, self.alpha * diagonal)
            });
            self.smooth.push(moved.unwrap_or(point));
        }
        &self.smooth
    }

    /// The alpha of the last cloud: (4.18) of the neighbours' mean distances, as a part of the cloud's diagonal.
    #[must_use]
    pub fn alpha(&self) -> f64 {
        self.alpha
    }

    fn find_alpha(&mut self, points: &[[f32; 3]], params: &MlsParams, diagonal: f64) {
        let (mut count, mut sum, mut squares) = (0.0, 0.0, 0.0);
        for number in 0..points.len() {
            self.neighbours.nearest(points, number, params.neighbours, &mut self.found);
            if !self.found.is_empty() {
                let total: f64 = self.found.iter().map(|(d, _)| f64::from(*d).sqrt()).sum();
                let mean = total / self.found.len() as f64 / diagonal;
                count += 1.0;
                sum += mean;
                squares += mean * mean;
            }
        }
        self.alpha = alpha(count, sum, squares, params.deviations);
    }
}

/// The diagonal of the points' bounding box in metres; 1 for points in one place, which need no scale.
fn diagonal(points: &[[f32; 3]]) -> f64 {
    let nothing = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
    let (low, high) = points.iter().map(|&p| vector(p)).fold(nothing, |(l, h), p| (l.inf(&p), h.sup(&p)));
    let length = (high - low).norm();
    if length > 0.0 && length.is_finite() { length } else { 1.0 }
}

/// The least-squares plane of those of `around` that agree with the best of some planes drawn.
fn reference_plane(around: &[[f32; 3]], tolerance: f64, rng: &mut impl Rng) -> Option<Plane> {
    if around.len() < NEEDED {
        return None;
    }
    let (mut best, mut least) = (None, f64::INFINITY);
    for _ in 0..DRAWS {
        let [a, b, c] = [(); 3].map(|()| around[below(rng, around.len())]);
        let Some(plane) = Plane::through(a, b, c) else { continue };
        // What is farther than the tolerance counts as if it were that far.
        let cost = around.iter().map(|&p| plane.height(p).abs().min(tolerance).powi(2)).sum();
        if cost < least {
            (best, least) = (Some(plane), cost);
        }
    }
    let plane: Plane = best?;
    Plane::fit(around.iter().copied().filter(|&p| plane.height(p).abs() <= tolerance))
}

/// Where `point` goes: its foot on the plane, and from there up the polynomial (4.20) weighted by (4.19).
fn onto_surface(
    point: [f32; 3],
    plane: &Plane,
    around: &[[f32; 3]],
    tolerance: f64,
    width: f64,
) -> Option<[f32; 3]> {
    let foot = vector(point) - plane.height(point) * plane.normal;
    let (u, v) = plane.axes();
    let (mut normal, mut right, mut used) = (Matrix6::zeros(), Vector6::zeros(), 0);
    for &neighbour in around {
        let height = plane.height(neighbour);
        if height.abs() > tolerance {
            continue;
        }
        let d = vector(neighbour) - foot;
        let weight = libm::exp(-d.norm_squared() / (width * width));
        // In widths, so that all coefficients are of one size.
        let (x, y) = (d.dot(&u) / width, d.dot(&v) / width);
        let terms = Vector6::new(1.0, x, y, x * x, x * y, y * y);
        normal += weight * terms * terms.transpose();
        right += weight * height * terms;
        used += 1;
    }
    if used < NEEDED {
        return None;
    }
    // Neighbours in line leave some coefficients open.
    let coefficients = normal.cholesky()?.solve(&right);
    let height = coefficients[0];
    (height.abs() <= tolerance).then(|| (foot + height * plane.normal).map(|c| c as f32).into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use chacha20::{ChaCha8Rng, rand_core::SeedableRng};

    const PARAMS: MlsParams = MlsParams { neighbours: 30, deviations: 1.0, tolerance: 0.01, cell: 0.008 };

    /// The cap of a ball of 90 mm, in points 5 mm apart, each off it along the view by `noise` times -1 to 1.
    fn cap(noise: f32) -> Vec<[f32; 3]> {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let mut points = Vec::new();
        for i in 0..625 {
            let (x, y) = ((i % 25) as f32 * 0.005 - 0.06, (i / 25) as f32 * 0.005 - 0.06);
            let z = 1.0 - (0.09_f32 * 0.09 - x * x - y * y).max(0.0).sqrt();
            let off = (below(&mut rng, 2001) as f32 - 1000.0) / 1000.0;
            if z < 0.97 {
                points.push([x, y, z + noise * off]);
            }
        }
        points
    }

    fn off_the_ball(points: &[[f32; 3]]) -> f64 {
        let squares = points.iter().map(|&p| ((vector(p) - Vector3::z()).norm() - 0.09).powi(2)).sum::<f64>();
        (squares / points.len() as f64).sqrt()
    }

    #[test]
    fn noise_falls_to_a_half_and_a_curved_surface_stays() {
        let mut mls = MovingLeastSquares::new();
        let noisy = cap(0.003);
        let smooth = mls.smooth(&noisy, &PARAMS, &mut ChaCha8Rng::seed_from_u64(1));
        let (before, after) = (off_the_ball(&noisy), off_the_ball(smooth));
        assert!(after < before / 2.0, "{before} {after}");
        let exact = cap(0.0);
        let after = off_the_ball(mls.smooth(&exact, &PARAMS, &mut ChaCha8Rng::seed_from_u64(1)));
        assert!(after < 2e-4, "{after}");
    }

    #[test]
    fn another_surface_near_by_does_not_pull() {
        let mut points: Vec<_> =
            (0..900).map(|i| [(i % 30) as f32 * 0.005, (i / 30) as f32 * 0.005, 1.0]).collect();
        points.extend((0..60).map(|i| [0.07 + (i % 6) as f32 * 0.002, 0.07 + (i / 6) as f32 * 0.001, 0.985]));
        let mut mls = MovingLeastSquares::new();
        let smooth = mls.smooth(&points, &PARAMS, &mut ChaCha8Rng::seed_from_u64(1));
        let moved = smooth[..900].iter().map(|p| (p[2] - 1.0).abs()).fold(0.0, f32::max);
        assert!(moved < 5e-4, "{moved}");
    }

    #[test]
    fn alpha_is_of_the_normalised_cloud() {
        let mut mls = MovingLeastSquares::new();
        let points = cap(0.001);
        let larger: Vec<_> = points.iter().map(|p| p.map(|c| c * 2.0)).collect();
        mls.smooth(&points, &PARAMS, &mut ChaCha8Rng::seed_from_u64(1));
        let alpha = mls.alpha();
        let params = MlsParams { cell: 0.016, tolerance: 0.02, ..PARAMS };
        mls.smooth(&larger, &params, &mut ChaCha8Rng::seed_from_u64(1));
        assert!((mls.alpha() - alpha).abs() < 1e-6 && alpha < 0.2, "{alpha} {}", mls.alpha());
    }

    #[test]
    fn few_points_stay_where_they_are() {
        let mut mls = MovingLeastSquares::new();
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        assert!(mls.smooth(&[], &PARAMS, &mut rng).is_empty());
        let few = [[0.0, 0.0, 1.0], [0.001, 0.0, 1.0], [0.0, 0.001, 1.2]];
        assert_eq!(mls.smooth(&few, &PARAMS, &mut rng), few);
        let line: Vec<_> = (0..40).map(|i| [i as f32 * 0.001, 0.0, 1.0]).collect();
        assert_eq!(mls.smooth(&line, &PARAMS, &mut rng), line);
    }
}
