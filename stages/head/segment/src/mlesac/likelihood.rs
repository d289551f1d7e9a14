//! How likely a plane makes the points.

use super::search::{Beneath, MlesacParams};

/// Expectation-maximisation steps for gamma, as in the paper's experiments.
const EM_STEPS: usize = 3;
/// How much less likely than another outlier a point beneath a supporting plane is: about e^-3.
const BENEATH: f64 = 0.05;
/// An inlier's residual is at most this many deviations.
const CUTOFF: f64 = 6.0;
/// Residuals are counted in bins, of which [`CUTOFF`] has so many: a tenth of a deviation each. The likelihood is then one
/// of 60 densities, not of all points.
const BINS: usize = 60;

/// The densities of a residual.
#[derive(Debug, Clone)]
pub(super) struct Likelihood {
    /// N(e; 0, sigma) in the middle of each bin; 0 beyond the cutoff.
    inlier_densities: [f64; BINS + 1],
    outlier_density: f64,
    bins_per_metre: f32,
    tolerance: f32,
    cutoff: f32,
    /// Residuals below this are of points beneath.
    deep: f32,
    log_beneath: f64,
}

/// Residuals, counted by what decides.
#[derive(Debug, Clone, Copy)]
pub(super) struct Counts {
    points: u32,
    /// Points within the tolerance.
    pub inliers: u32,
    /// Points within the cutoff.
    near: u32,
    /// Points on the far side of the plane.
    beneath: u32,
}

impl Likelihood {
    /// Densities for points whose bounding box has a diagonal of `diagonal` metres: as far off can an outlier be.
    pub fn new(params: &MlesacParams, diagonal: f64) -> Self {
        let sigma = params.tolerance / 1.96;
        let peak = 1.0 / (sigma * (2.0 * std::f64::consts::PI).sqrt());
        let width = CUTOFF / BINS as f64;
        let mut inlier_densities = [0.0; BINS + 1];
        for (bin, density) in inlier_densities[..BINS].iter_mut().enumerate() {
            let e = (bin as f64 + 0.5) * width;
            *density = peak * libm::exp(-0.5 * e * e);
        }
        Self {
            inlier_densities,
            outlier_density: 1.0 / diagonal.max(params.tolerance),
            bins_per_metre: (1.0 / (width * sigma)) as f32,
            tolerance: params.tolerance as f32,
            cutoff: (CUTOFF * sigma) as f32,
            deep: (-2.0 * params.tolerance) as f32,
            log_beneath: match params.beneath {
                Beneath::Outliers => 0.0,
                Beneath::Unlikely => libm::log(BENEATH),
            },
        }
    }

    /// Counts residuals, in metres.
    pub fn count(&self, residuals: &[f32]) -> Counts {
        Counts {
            points: residuals.len() as u32,
            inliers: count(residuals, |e| e.abs() <= self.tolerance),
            near: count(residuals, |e| e.abs() <= self.cutoff),
            beneath: count(residuals, |e| e < self.deep),
        }
    }

    /// What no residuals of these counts are likelier than: all that are near are in the plane, and gamma is the best one.
    pub fn log_at_most(&self, counts: &Counts) -> f64 {
        let (points, near) = (f64::from(counts.points), f64::from(counts.near));
        let (inlier, outlier) = (self.inlier_densities[0], self.outlier_density);
        // Where an outlier is the likelier of the two, gamma had best be small.
        let ratio = if inlier > outlier { outlier / (inlier - outlier) } else { f64::INFINITY };
        let share = near / points;
        let gamma = (share - (1.0 - share).max(1e-9) * ratio).clamp(0.01, 0.99);
        let beyond = (1.0 - gamma) * outlier;
        near * libm::log(gamma * inlier + beyond)
            + (points - near) * libm::log(beyond)
            + f64::from(counts.beneath) * self.log_beneath
    }

    /// The log-likelihood of the residuals with the best gamma, started at the fraction of inliers.
    pub fn log_of(&self, residuals: &[f32], counts: &Counts) -> f64 {
        let mut bins = [0_u32; BINS + 1];
        for e in residuals {
            // Through i32, for which the processor has an instruction. Points are finite.
            bins[(e.abs() * self.bins_per_metre).min(BINS as f32) as i32 as usize] += 1;
        }
        let weighted = || self.inlier_densities.iter().zip(bins.map(f64::from));
        let points = f64::from(counts.points);
        // Neither kind may vanish, or its weight stays 0.
        let mut gamma = (f64::from(counts.inliers) / points).clamp(0.01, 0.99);
        for _ in 0..EM_STEPS {
            let outlier = (1.0 - gamma) * self.outlier_density;
            let weights: f64 = weighted().map(|(p, n)| n * (gamma * p / (gamma * p + outlier))).sum();
            gamma = (weights / points).clamp(0.01, 0.99);
        }
        let outlier = (1.0 - gamma) * self.outlier_density;
        let seen = weighted().filter(|(_, n)| *n > 0.0);
        seen.map(|(p, n)| n * libm::log(gamma * p + outlier)).sum::<f64>()
            + f64::from(counts.beneath) * self.log_beneath
    }
}

fn count(residuals: &[f32], is: impl Fn(f32) -> bool) -> u32 {
    residuals.iter().map(|&e| u32::from(is(e))).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const PARAMS: MlesacParams = MlesacParams { tolerance: 0.01, iterations: 1, beneath: Beneath::Outliers };

    /// The same from every residual by itself.
    fn by_each(residuals: &[f32], diagonal: f64) -> f64 {
        let sigma = PARAMS.tolerance / 1.96;
        let peak = 1.0 / (sigma * (2.0 * std::f64::consts::PI).sqrt());
        let density = |e: &f32| {
            let e = f64::from(*e) / sigma;
            if e.abs() > CUTOFF { 0.0 } else { peak * (-0.5 * e * e).exp() }
        };
        let count = residuals.len() as f64;
        let inliers = residuals.iter().filter(|e| e.abs() <= 0.01).count();
        let mut gamma = inliers as f64 / count;
        let mixed =
            |gamma: f64| residuals.iter().map(move |e| (gamma * density(e), (1.0 - gamma) / diagonal));
        for _ in 0..EM_STEPS {
            gamma = mixed(gamma).map(|(a, b)| a / (a + b)).sum::<f64>() / count;
        }
        mixed(gamma).map(|(a, b)| (a + b).ln()).sum()
    }

    #[test]
    fn binned_residuals_are_as_likely_as_each_by_itself() {
        // Near the plane and far off, anywhere in a bin.
        let part = |i: u32, step: f64| (f64::from(i) * step).fract() as f32;
        let residuals: Vec<f32> = (0..1000)
            .map(|i| if i % 3 == 0 { part(i, 0.618) } else { 0.01 * (part(i, 0.618) + part(i, 0.414) - 1.0) })
            .collect();
        let likelihood = Likelihood::new(&PARAMS, 0.7);
        let found = likelihood.log_of(&residuals, &likelihood.count(&residuals));
        assert!((found - by_each(&residuals, 0.7)).abs() < 0.5, "{found} {}", by_each(&residuals, 0.7));
    }

    proptest! {
        #[test]
        fn nothing_is_likelier_than_its_bound(
            residuals in prop::collection::vec(-0.2..0.2_f32, 3..300),
            flat in 0.0..1.0_f32,
        ) {
            let residuals: Vec<f32> = residuals.into_iter().map(|e| e * flat * flat).collect();
            for beneath in [Beneath::Outliers, Beneath::Unlikely] {
                let likelihood = Likelihood::new(&MlesacParams { beneath, ..PARAMS }, 0.5);
                let counts = likelihood.count(&residuals);
                let (found, most) = (likelihood.log_of(&residuals, &counts), likelihood.log_at_most(&counts));
                prop_assert!(found <= most + 1e-9, "{found} {most}");
            }
        }
    }

    #[test]
    fn points_beneath_count_against_a_supporting_plane_only() {
        let residuals = [0.0, 0.001, -0.3, -0.4, 0.3];
        let log_of = |beneath| {
            let likelihood = Likelihood::new(&MlesacParams { beneath, ..PARAMS }, 1.0);
            likelihood.log_of(&residuals, &likelihood.count(&residuals))
        };
        let apart = log_of(Beneath::Outliers) - log_of(Beneath::Unlikely);
        assert!((apart + 2.0 * BENEATH.ln()).abs() < 1e-9, "{apart}");
    }
}
