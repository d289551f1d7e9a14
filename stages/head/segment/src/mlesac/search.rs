//! Hypotheses: planes through three points, drawn and compared.

use super::fit::{Origin, PlaneFit, refine};
use super::likelihood::{Counts, Likelihood};
use crate::plane::Plane;
use rand::Rng;

/// How a plane is searched.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MlesacParams {
    /// Distance within which a point belongs to the plane, in metres: 1.96 sigma.
    pub tolerance: f64,
    /// Hypotheses at most; fewer are drawn once a better one is unlikely.
    pub iterations: u32,
    /// What points beneath a plane say of it.
    pub beneath: Beneath,
}

/// The meaning of points on the far side of a plane, as seen from the origin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Beneath {
    /// They are outliers like others.
    Outliers,
    /// They make the plane unlikely: a camera does not see objects under a couch.
    Unlikely,
}

/// Points that a hypothesis is scored on.
const SCORED: usize = 1024;
/// Probability that at least one hypothesis was drawn from inliers alone, at which the search ends.
const CONFIDENCE: f64 = 0.9999;
/// A hypothesis with fewer inliers than this fraction of the best one's is not scored further.
const BAIL_OUT: f64 = 0.8;

/// The search with its buffers; after the first frame it allocates nothing.
#[derive(Debug, Clone, Default)]
pub struct Mlesac {
    xs: Vec<f32>,
    ys: Vec<f32>,
    zs: Vec<f32>,
    residuals: Vec<f32>,
}

/// A number below `bound`, from 32 random bits by multiplication (Lemire); the bias is below `bound` / 2^32.
pub(crate) fn below(rng: &mut impl Rng, bound: usize) -> usize {
    ((u64::from(rng.next_u32()) * bound as u64) >> 32) as usize
}

impl Mlesac {
    /// A search without buffers yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// The plane that most of `points` (finite, in metres) lie on; `None` where no three of those drawn span one.
    ///
    /// A `prior`, such as the plane of the last frame, is the first hypothesis. It is refined with these points and has
    /// to be as likely as every plane that is drawn. The number of draws is large enough to find a plane with its share
    /// of inliers without the prior. So a prior saves draws and steadies the result, but it is always tested.
    pub fn find(
        &mut self,
        points: &[[f32; 3]],
        prior: Option<&Plane>,
        params: &MlesacParams,
        rng: &mut impl Rng,
    ) -> Option<PlaneFit> {
        if points.len() < 3 {
            return None;
        }
        self.draw_scored(points, rng);
        let likelihood = Likelihood::new(params, self.diagonal());
        let share = |counts: &Counts| f64::from(counts.inliers) / SCORED as f64;
        let (mut best, mut best_score, mut best_inliers) = (None, f64::NEG_INFINITY, 0);
        let (mut iteration, mut needed) = (0, params.iterations);
        if let Some(plane) = prior.and_then(|prior| self.refined_on_scored(prior, params.tolerance)) {
            let residuals = self.residuals(&plane);
            let counts = likelihood.count(residuals);
            let score = likelihood.log_of(residuals, &counts);
            (best, best_score, best_inliers) = (Some((plane, Origin::Retained)), score, counts.inliers);
            needed = needed_iterations(share(&counts)).min(params.iterations);
        }
        while iteration < needed {
            iteration += 1;
            let [a, b, c] = [(); 3].map(|()| points[below(rng, points.len())]);
            let Some(plane) = Plane::through(a, b, c) else { continue };
            let residuals = self.residuals(&plane);
            let counts = likelihood.count(residuals);
            let few = f64::from(counts.inliers) < BAIL_OUT * f64::from(best_inliers);
            let hopeless = few && params.beneath == Beneath::Outliers;
            if hopeless || likelihood.log_at_most(&counts) <= best_score {
                continue;
            }
            let score = likelihood.log_of(residuals, &counts);
            if score > best_score {
                (best, best_score, best_inliers) = (Some((plane, Origin::Searched)), score, counts.inliers);
                needed = needed_iterations(share(&counts)).min(params.iterations);
            }
        }
        let (plane, origin) = best?;
        refine(points, &plane, params.tolerance, origin, iteration)
    }

    /// `plane` fitted to those of the scored points that lie within the tolerance of it.
    fn refined_on_scored(&self, plane: &Plane, tolerance: f64) -> Option<Plane> {
        let scored = self.xs.iter().zip(&self.ys).zip(&self.zs).map(|((&x, &y), &z)| [x, y, z]);
        Plane::fit(scored.filter(|&p| plane.height(p).abs() <= tolerance))
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

    /// The scored points' distances to `plane`.
    fn residuals(&mut self, plane: &Plane) -> &[f32] {
        let [nx, ny, nz] = [plane.normal.x as f32, plane.normal.y as f32, plane.normal.z as f32];
        let offset = plane.offset as f32;
        self.residuals.clear();
        let scored = self.xs.iter().zip(&self.ys).zip(&self.zs);
        self.residuals.extend(scored.map(|((x, y), z)| nx * x + ny * y + nz * z + offset));
        &self.residuals
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

    const PARAMS: MlesacParams =
        MlesacParams { tolerance: 0.008, iterations: 500, beneath: Beneath::Outliers };

    #[test]
    fn plane_is_found_among_as_many_outliers_for_every_seed() {
        for seed in 0..50 {
            let (points, truth) = scene(seed);
            let fit = Mlesac::new()
                .find(&points, None, &PARAMS, &mut ChaCha8Rng::seed_from_u64(1000 + seed))
                .unwrap();
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
        used.find(&points[..700], None, &PARAMS, &mut ChaCha8Rng::seed_from_u64(5));
        let repeated = used.find(&points, None, &PARAMS, &mut ChaCha8Rng::seed_from_u64(9)).unwrap();
        let fresh = Mlesac::new().find(&points, None, &PARAMS, &mut ChaCha8Rng::seed_from_u64(9)).unwrap();
        assert_eq!(repeated, fresh);
    }

    #[test]
    fn a_prior_that_still_fits_is_kept_and_follows_the_points() {
        let (points, truth) = scene(3);
        // The couch sank by 3 mm and tilted by 0.2 degrees since.
        let prior = Plane {
            normal: truth.normal + nalgebra::Vector3::new(0.0, 0.0035, 0.0),
            offset: truth.offset + 0.003,
        };
        let prior = Plane { normal: prior.normal.normalize(), ..prior };
        for seed in 0..50 {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let fit = Mlesac::new().find(&points, Some(&prior), &PARAMS, &mut rng).unwrap();
            assert!(
                fit.plane.angle_to(&truth).to_degrees() < 0.1
                    && (fit.plane.offset - truth.offset).abs() < 5e-4
            );
            assert_eq!(fit.origin, Origin::Retained, "seed {seed}");
        }
    }

    #[test]
    fn a_prior_that_does_not_fit_is_given_up() {
        let (points, truth) = scene(3);
        // Another height, another tilt, and a plane through the scattered points.
        let others = [
            Plane { offset: truth.offset + 0.05, ..truth },
            Plane::through([0.0, 0.0, 1.0], [0.2, 0.0, 1.0], [0.0, 0.2, 1.05]).unwrap(),
            Plane::through([0.0, 0.0, 0.6], [0.2, 0.0, 0.6], [0.0, 0.2, 0.6]).unwrap(),
        ];
        for (seed, prior) in others.iter().enumerate() {
            let mut rng = ChaCha8Rng::seed_from_u64(seed as u64);
            let fit = Mlesac::new().find(&points, Some(prior), &PARAMS, &mut rng).unwrap();
            assert_eq!(fit.origin, Origin::Searched);
            assert!(
                fit.plane.angle_to(&truth).to_degrees() < 0.1
                    && (fit.plane.offset - truth.offset).abs() < 5e-4
            );
        }
    }

    #[test]
    fn what_supports_all_else_is_found_under_something_larger() {
        // A board 0.2 m over the table hides most of it: four points for three.
        let mut points = Vec::new();
        for i in 0..3000_u32 {
            let (x, y) = ((i % 60) as f32 * 0.01 - 0.3, (i / 60) as f32 * 0.01 - 0.25);
            points.push([x, y, 0.8]);
            if i % 4 != 0 {
                points.push([x * 2.0, y + if y < 0.0 { -0.5 } else { 0.5 }, 1.0]);
            }
        }
        let find = |beneath| {
            let params = MlesacParams { beneath, ..PARAMS };
            let mut rng = ChaCha8Rng::seed_from_u64(1);
            Mlesac::new().find(&points, None, &params, &mut rng).unwrap().plane.offset
        };
        assert!((find(Beneath::Outliers) - 0.8).abs() < 1e-6);
        assert!((find(Beneath::Unlikely) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn clouds_without_a_plane_give_none() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let line: Vec<_> = (0..100).map(|i| [i as f32, 0.0, 1.0]).collect();
        for points in [&line[..0], &line[..2], &line[..], &[[1.0, 2.0, 3.0]; 10]] {
            assert_eq!(Mlesac::new().find(points, None, &PARAMS, &mut rng), None);
        }
    }

    #[test]
    fn fewer_draws_are_needed_the_more_points_agree() {
        assert_eq!(needed_iterations(1.0), 1);
        assert_eq!(needed_iterations(0.5), 69);
        assert_eq!(needed_iterations(0.0), u32::MAX);
    }
}
