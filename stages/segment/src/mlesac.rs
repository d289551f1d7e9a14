//! MLESAC (Torr and Zisserman, 2000): the plane under which a cloud is most likely.
//!
//! A residual e is an inlier's, normal with deviation sigma, or an outlier's, uniform over nu metres:
//! p(e) = gamma N(e; 0, sigma) + (1 - gamma) / nu. A hypothesis is a plane through three points drawn at random; its
//! gamma comes from a few steps of expectation maximisation; the greatest log-likelihood wins.

use crate::plane::Plane;
use rand::Rng;

/// How a plane is searched.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MlesacParams {
    /// Distance within which a point belongs to the plane, in metres: 1.96 sigma.
    pub tolerance: f64,
    /// Hypotheses at most; fewer are drawn once a better one is unlikely.
    pub iterations: u32,
}

/// A plane and the points on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaneFit {
    /// Least-squares plane of its inliers.
    pub plane: Plane,
    /// Points within the tolerance.
    pub inliers: usize,
}

/// Points that a hypothesis is scored on.
const SCORED: usize = 1024;
/// Probability that at least one hypothesis was drawn from inliers alone, at which the search ends.
const CONFIDENCE: f64 = 0.9999;
/// Expectation-maximisation steps for gamma, as in the paper's experiments.
const EM_STEPS: usize = 3;
/// A hypothesis with fewer inliers than this fraction of the best one's is not scored further.
const BAIL_OUT: f64 = 0.8;
/// Fits to the inliers at most, each with the inliers of the one before.
const REFINEMENTS: usize = 5;

/// The search with its buffers; after the first frame it allocates nothing.
#[derive(Debug, Clone, Default)]
pub struct Mlesac {
    xs: Vec<f32>,
    ys: Vec<f32>,
    zs: Vec<f32>,
    residuals: Vec<f32>,
    densities: Vec<f64>,
}

/// A number below `bound`, from 32 random bits by multiplication (Lemire); the bias is below `bound` / 2^32.
fn below(rng: &mut impl Rng, bound: usize) -> usize {
    ((u64::from(rng.next_u32()) * bound as u64) >> 32) as usize
}

impl Mlesac {
    /// A search without buffers yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// The plane that most of `points` (finite, in metres) lie on; `None` where no three of those drawn span one.
    pub fn find(
        &mut self,
        points: &[[f32; 3]],
        params: &MlesacParams,
        rng: &mut impl Rng,
    ) -> Option<PlaneFit> {
        if points.len() < 3 {
            return None;
        }
        self.draw_scored(points, rng);
        let scale = Scale::new(params.tolerance, self.diagonal());
        let (mut best, mut best_score, mut best_inliers) = (None, f64::NEG_INFINITY, 0);
        let (mut iteration, mut needed) = (0, params.iterations);
        while iteration < needed {
            iteration += 1;
            let [a, b, c] = [(); 3].map(|()| points[below(rng, points.len())]);
            let Some(plane) = Plane::through(a, b, c) else { continue };
            let inliers = self.residuals(&plane, params.tolerance as f32);
            if (inliers as f64) < BAIL_OUT * best_inliers as f64 {
                continue;
            }
            let score = self.log_likelihood(&scale, inliers);
            if score > best_score {
                (best, best_score, best_inliers) = (Some(plane), score, inliers);
                needed = needed_iterations(inliers as f64 / self.xs.len() as f64).min(params.iterations);
            }
        }
        refine(points, best?, params.tolerance)
    }

    fn draw_scored(&mut self, points: &[[f32; 3]], rng: &mut impl Rng) {
        for coordinates in [&mut self.xs, &mut self.ys, &mut self.zs] {
            coordinates.clear();
        }
        for _ in 0..SCORED {
            let [x, y, z] = points[below(rng, points.len())];
            self.xs.push(x);
            self.ys.push(y);
            self.zs.push(z);
        }
    }

    /// Diagonal of the scored points' bounding box, in metres: how far off an outlier can be.
    fn diagonal(&self) -> f64 {
        let extent = |values: &[f32]| {
            let (low, high) = values
                .iter()
                .fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), &v| (low.min(v), high.max(v)));
            f64::from(high - low)
        };
        let [x, y, z] = [&self.xs, &self.ys, &self.zs].map(|values| extent(values));
        (x * x + y * y + z * z).sqrt()
    }

    /// Computes the scored points' distances to `plane` and counts those within `tolerance`.
    fn residuals(&mut self, plane: &Plane, tolerance: f32) -> usize {
        let [nx, ny, nz] = [plane.normal.x as f32, plane.normal.y as f32, plane.normal.z as f32];
        let offset = plane.offset as f32;
        self.residuals.clear();
        self.residuals.extend(
            self.xs.iter().zip(&self.ys).zip(&self.zs).map(|((x, y), z)| nx * x + ny * y + nz * z + offset),
        );
        self.residuals.iter().map(|e| u32::from(e.abs() <= tolerance)).sum::<u32>() as usize
    }

    /// The log-likelihood of the residuals with the best gamma, started at the fraction of inliers.
    fn log_likelihood(&mut self, scale: &Scale, inliers: usize) -> f64 {
        self.densities.clear();
        self.densities.extend(self.residuals.iter().map(|&e| scale.inlier_density(f64::from(e))));
        let count = self.densities.len() as f64;
        // Neither kind may vanish, or its weight stays 0.
        let mut gamma = (inliers as f64 / count).clamp(0.01, 0.99);
        for _ in 0..EM_STEPS {
            let outlier = (1.0 - gamma) * scale.outlier_density;
            let weights: f64 = self.densities.iter().map(|p| gamma * p / (gamma * p + outlier)).sum();
            gamma = (weights / count).clamp(0.01, 0.99);
        }
        let outlier = (1.0 - gamma) * scale.outlier_density;
        // One logarithm for the product of eight: densities are far from the ends of the exponent.
        self.densities
            .chunks(8)
            .map(|chunk| libm::log(chunk.iter().map(|p| gamma * p + outlier).product()))
            .sum()
    }
}

/// The two densities of a residual.
struct Scale {
    peak: f64,
    inverse_two_variance: f64,
    cutoff: f64,
    outlier_density: f64,
}

impl Scale {
    fn new(tolerance: f64, diagonal: f64) -> Self {
        let sigma = tolerance / 1.96;
        Self {
            peak: 1.0 / (sigma * (2.0 * std::f64::consts::PI).sqrt()),
            inverse_two_variance: 0.5 / (sigma * sigma),
            cutoff: 6.0 * sigma,
            outlier_density: 1.0 / diagonal.max(tolerance),
        }
    }

    /// N(e; 0, sigma), 0 beyond six deviations.
    #[inline]
    fn inlier_density(&self, e: f64) -> f64 {
        if e.abs() > self.cutoff { 0.0 } else { self.peak * libm::exp(-e * e * self.inverse_two_variance) }
    }
}

/// Draws after which three inliers were drawn together with [`CONFIDENCE`], where a fraction `w` are inliers.
fn needed_iterations(w: f64) -> u32 {
    let all_inliers = w * w * w;
    if all_inliers >= 1.0 {
        return 1;
    }
    // A cast saturates where almost nothing is an inlier.
    (libm::log(1.0 - CONFIDENCE) / libm::log1p(-all_inliers)).ceil() as u32
}

/// Fits to the inliers until they stay the same in number, in the order of the points.
fn refine(points: &[[f32; 3]], start: Plane, tolerance: f64) -> Option<PlaneFit> {
    let on = |plane: Plane| points.iter().copied().filter(move |&p| plane.height(p).abs() <= tolerance);
    let (mut plane, mut inliers) = (start, 0);
    for _ in 0..REFINEMENTS {
        let next = Plane::fit(on(plane))?;
        let count = on(next).count();
        plane = next;
        if count == inliers {
            break;
        }
        inliers = count;
    }
    Some(PlaneFit { plane, inliers })
}

#[cfg(test)]
mod tests {
    use super::*;
    use chacha20::{ChaCha8Rng, rand_core::SeedableRng};

    /// A tilted plane with noise of 2 mm, and as many points scattered in a box above it.
    fn scene(seed: u64) -> (Vec<[f32; 3]>, Plane) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut unit = || below(&mut rng, 1 << 20) as f32 / (1 << 20) as f32;
        let mut points = Vec::new();
        for _ in 0..4000 {
            let (x, y) = (unit() - 0.5, unit() - 0.5);
            let noise = (unit() + unit() + unit() - 1.5) * 0.004;
            points.push([x, y, 1.0 + 0.5 * x + noise]);
            points.push([unit() - 0.5, unit() - 0.5, 0.4 + 0.4 * unit()]);
        }
        let truth = Plane::through([0.0, 0.0, 1.0], [0.2, 0.0, 1.1], [0.0, 0.2, 1.0]).unwrap();
        (points, truth)
    }

    const PARAMS: MlesacParams = MlesacParams { tolerance: 0.008, iterations: 500 };

    #[test]
    fn plane_is_found_among_as_many_outliers_for_every_seed() {
        for seed in 0..50 {
            let (points, truth) = scene(seed);
            let fit =
                Mlesac::new().find(&points, &PARAMS, &mut ChaCha8Rng::seed_from_u64(1000 + seed)).unwrap();
            let degrees = fit.plane.angle_to(&truth).to_degrees();
            let millimetres = (fit.plane.offset - truth.offset).abs() * 1000.0;
            assert!(degrees < 0.1 && millimetres < 0.5, "seed {seed}: {degrees} deg, {millimetres} mm");
            assert!(fit.inliers >= 3900, "{}", fit.inliers);
        }
    }

    #[test]
    fn same_seed_gives_the_same_bits_in_fresh_and_used_buffers() {
        let (points, _) = scene(3);
        let mut used = Mlesac::new();
        used.find(&points[..700], &PARAMS, &mut ChaCha8Rng::seed_from_u64(5));
        let again = used.find(&points, &PARAMS, &mut ChaCha8Rng::seed_from_u64(9)).unwrap();
        let fresh = Mlesac::new().find(&points, &PARAMS, &mut ChaCha8Rng::seed_from_u64(9)).unwrap();
        assert_eq!(again, fresh);
    }

    #[test]
    fn clouds_without_a_plane_give_none() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let line: Vec<_> = (0..100).map(|i| [i as f32, 0.0, 1.0]).collect();
        for points in [&line[..0], &line[..2], &line[..], &[[1.0, 2.0, 3.0]; 10]] {
            assert_eq!(Mlesac::new().find(points, &PARAMS, &mut rng), None);
        }
    }

    #[test]
    fn fewer_draws_are_needed_the_more_points_agree() {
        assert_eq!(needed_iterations(1.0), 1);
        assert_eq!(needed_iterations(0.5), 69);
        assert_eq!(needed_iterations(0.0), u32::MAX);
    }
}
