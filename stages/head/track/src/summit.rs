//! How high the highest place of a cloud is: one coordinate, as the dissertation's distance to the forehead (4.2.2).
//!
//! The highest points alone would be those whose noise is highest. So they only say where to begin; from there it goes
//! to the top of the quadric that fits the points within a radius, and the height is the mean of that quadric over the
//! disc of this radius. At the top the surface is level: that noise moves the place, or which points it takes into the
//! disc, moves the height by little. The mean of the points themselves would change with both, and their spread has the
//! shape of the surface in it, which is the same in every frame.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};

/// Points that a quadric needs: twice its six unknowns. Of fewer the mean is taken.
const FITTED: usize = 12;
/// So many times the variance of their mean, a mean over the disc is not known by the points.
const MOST_SPREAD: f64 = 10.0;
/// Steps from the mean place of the highest points to the top, and how long one is at most, in radii.
const STEPS: usize = 2;
const STEP: f64 = 0.5;

/// The highest patch of a cloud.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Summit {
    /// Its centre in the two other axes, and its mean height along the chosen axis, m.
    pub position: [f64; 3],
    /// Variance of the height, m2: what the points scatter about the quadric, by the law of least squares. An error
    /// that all points share is not in it.
    pub variance: f64,
    /// Points of the patch.
    pub count: usize,
}

/// Finds summits, with room for the heights of a cloud that grows to the largest one seen.
#[derive(Debug, Clone, Default)]
pub struct SummitFinder {
    heights: Vec<f32>,
}

impl SummitFinder {
    /// The summit of points whose third coordinate is the height, m: sought from the mean place of the highest `share`
    /// of them, averaged within `radius` (m, across). `None` where fewer than two points are there.
    pub fn find(&mut self, points: &[[f32; 3]], share: f64, radius: f64) -> Option<Summit> {
        let points = points.iter().copied().filter(|p| p.iter().all(|c| c.is_finite()));
        self.heights.clear();
        self.heights.extend(points.clone().map(|p| p[2]));
        let many = self.heights.len();
        let top = ((many as f64 * share).ceil() as usize).clamp(1, many.max(1));
        if many < 2 {
            return None;
        }
        let (_, least, _) = self.heights.select_nth_unstable_by(many - top, f32::total_cmp);
        let least = *least;
        let points = points.map(|p| p.map(f64::from));
        let [x, y, _] = mean(points.clone().filter(|p| p[2] >= f64::from(least)))?.0;
        let mut middle = Vector2::new(x, y);
        for _ in 0..STEPS {
            let Some(step) = Quadric::fit(points.clone(), &middle, radius).and_then(|q| q.step_to_top())
            else {
                break;
            };
            middle += step * radius;
        }
        match Quadric::fit(points.clone(), &middle, radius) {
            Some(quadric) => Some(Summit {
                position: [middle.x, middle.y, quadric.coefficients[0]],
                variance: quadric.variance,
                count: quadric.count,
            }),
            None => mean_about(points, &middle, radius),
        }
    }
}

/// `c0 + c1 u + c2 v + c3 (u^2 - 1/4) + c4 u v + c5 (v^2 - 1/4)` over the disc about a place, u and v in its radii. The
/// mean of all but the first over the disc is 0.
#[derive(Debug, Clone, Copy)]
struct Quadric {
    coefficients: SVector<f64, 6>,
    /// Variance of the first coefficient.
    variance: f64,
    count: usize,
}

impl Quadric {
    /// The quadric of least squares. `None` where the points are too few or lie in a row.
    fn fit(
        points: impl Iterator<Item = [f64; 3]> + Clone,
        middle: &Vector2<f64>,
        radius: f64,
    ) -> Option<Self> {
        let rows = within(points, middle, radius).map(|p| {
            let (u, v) = ((p[0] - middle.x) / radius, (p[1] - middle.y) / radius);
            (SVector::<f64, 6>::from([1.0, u, v, u * u - 0.25, u * v, v * v - 0.25]), p[2])
        });
        let (mut normal, mut right) = (SMatrix::<f64, 6, 6>::zeros(), SVector::<f64, 6>::zeros());
        let mut count = 0_usize;
        for (row, height) in rows.clone() {
            normal.syger(1.0, &row, &row, 1.0);
            right.axpy(height, &row, 1.0);
            count += 1;
        }
        if count < FITTED {
            return None;
        }
        normal.fill_upper_triangle_with_lower_triangle();
        let inverse = normal.cholesky()?.inverse();
        let coefficients = inverse * right;
        let squares: f64 = rows.map(|(row, height)| (height - row.dot(&coefficients)).powi(2)).sum();
        let variance = squares / (count - 6) as f64 * inverse[(0, 0)];
        // Of points spread over the disc this product is hardly above 1; of points in a row there is no inverse but
        // rounding.
        let spread = inverse[(0, 0)] * count as f64;
        let sound = (0.0..MOST_SPREAD).contains(&spread) && coefficients.iter().all(|c| c.is_finite());
        sound.then_some(Self { coefficients, variance, count })
    }

    /// From the middle towards the top, in radii. `None` where the quadric has none.
    fn step_to_top(&self) -> Option<Vector2<f64>> {
        let c = &self.coefficients;
        let falls = Matrix2::new(-2.0 * c[3], -c[4], -c[4], -2.0 * c[5]).cholesky()?;
        let step = falls.solve(&Vector2::new(c[1], c[2]));
        let length = step.norm();
        length.is_finite().then(|| if length > STEP { step * (STEP / length) } else { step })
    }
}

fn within(
    points: impl Iterator<Item = [f64; 3]> + Clone,
    middle: &Vector2<f64>,
    radius: f64,
) -> impl Iterator<Item = [f64; 3]> + Clone {
    points.filter(move |p| (Vector2::new(p[0], p[1]) - middle).norm_squared() <= radius * radius)
}

/// The mean of the points about a place, and its variance as that of the points over their number: with the shape of
/// the surface in it, more than there is.
fn mean_about(
    points: impl Iterator<Item = [f64; 3]> + Clone,
    middle: &Vector2<f64>,
    radius: f64,
) -> Option<Summit> {
    let points = within(points, middle, radius);
    let (position, count) = mean(points.clone())?;
    let squares: f64 = points.map(|p| (p[2] - position[2]).powi(2)).sum();
    let n = count as f64;
    (count > 1).then(|| Summit { position, variance: squares / (n * (n - 1.0)), count })
}

/// Mean and number of points, summed in their order.
fn mean(points: impl Iterator<Item = [f64; 3]>) -> Option<([f64; 3], usize)> {
    let (mut sum, mut count) = ([0.0; 3], 0_usize);
    for p in points {
        (0..3).for_each(|i| sum[i] += p[i]);
        count += 1;
    }
    (count > 0).then(|| (sum.map(|s| s / count as f64), count))
}

#[cfg(test)]
mod tests {
    use super::*;
    use chacha20::ChaCha8Rng;
    use chacha20::rand_core::{Rng, SeedableRng};

    /// What a camera with this many mm between its pixels sees of a dome whose top is at (10, -20, 150) mm, with noise
    /// of this standard deviation, mm.
    fn dome(radius: f64, spacing: f64, noise: f64, seed: u64) -> Vec<[f32; 3]> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut unit = || f64::from(random.next_u32()) / f64::from(u32::MAX);
        let shift = [unit(), unit()];
        let steps = (0.6 * radius / spacing) as i32;
        let mut points = Vec::new();
        for i in -steps..=steps {
            for j in -steps..=steps {
                let [x, y] = [(f64::from(i) + shift[0]) * spacing, (f64::from(j) + shift[1]) * spacing];
                let normal: f64 = (0..12).map(|_| unit()).sum::<f64>() - 6.0;
                let z = (radius * radius - x * x - y * y).sqrt() - radius + noise * normal;
                points.push([x + 10.0, y - 20.0, z + 150.0].map(|mm| (mm * 1e-3) as f32));
            }
        }
        points
    }

    #[test]
    fn summit_of_a_dome_is_its_top() {
        let found = SummitFinder::default().find(&dome(100.0, 1.0, 0.0, 1), 0.01, 0.00805).unwrap();
        assert!((found.position[0] - 0.01).abs() < 1e-5 && (found.position[1] + 0.02).abs() < 1e-5);
        // The mean height over a disc of 8 mm is 162 um below the top.
        assert!((found.position[2] - 0.15 + 162e-6).abs() < 2e-6, "{found:?}");
        assert!(found.variance.sqrt() < 1e-7 && found.count > 190, "{found:?}");
    }

    #[test]
    fn heights_scatter_as_they_claim_on_any_dome() {
        // From the tip of a nose to a forehead, with the noise of cameras from fine to coarse.
        for (radius, spacing, noise) in
            [(8.0, 1.0, 1.3), (20.0, 1.6, 1.3), (100.0, 1.6, 1.3), (100.0, 1.6, 0.2), (300.0, 1.6, 1.3)]
        {
            let mut finder = SummitFinder::default();
            let found: Vec<Summit> = (0..600)
                .map(|seed| {
                    finder.find(&dome(radius, spacing, noise, seed), 0.05, 0.3 * radius.min(27.0) * 1e-3)
                })
                .collect::<Option<_>>()
                .unwrap();
            let mean = |of: fn(&Summit) -> f64| found.iter().map(of).sum::<f64>() / found.len() as f64;
            let height = mean(|s| s.position[2]);
            let actual =
                found.iter().map(|s| (s.position[2] - height).powi(2)).sum::<f64>() / found.len() as f64;
            let ratio = mean(|s| s.variance) / actual;
            assert!((0.85..1.2).contains(&ratio), "radius {radius} mm, noise {noise} mm: {ratio}");
            // The highest points are 3 deviations too high; the height is not.
            let off = (height - 0.15 + (0.3 * radius.min(27.0)).powi(2) / (4e3 * radius)) * 1e3;
            assert!(off.abs() < 0.15 * noise, "radius {radius} mm, noise {noise} mm: {off} mm");
        }
    }

    #[test]
    fn few_points_are_averaged() {
        let points: Vec<[f32; 3]> = (0..8).map(|i| [i as f32 * 1e-3, 0.0, (i % 2) as f32]).collect();
        let found = SummitFinder::default().find(&points, 1.0, 1.0).unwrap();
        assert_eq!((found.count, found.position[2]), (8, 0.5));
        assert!((found.variance - 0.25 / 7.0).abs() < 1e-12);
        // So are many in a row: no quadric is theirs.
        let row: Vec<[f32; 3]> = (0..40).map(|i| [i as f32 * 1e-3, 0.0, (i % 2) as f32]).collect();
        assert_eq!(SummitFinder::default().find(&row, 1.0, 1.0).unwrap().position[2], 0.5);
    }

    #[test]
    fn cloud_without_two_finite_points_has_no_summit() {
        let mut finder = SummitFinder::default();
        assert_eq!(finder.find(&[], 0.1, 1.0), None);
        assert_eq!(finder.find(&[[0.0; 3], [f32::NAN; 3], [0.0, f32::INFINITY, 0.0]], 0.1, 1.0), None);
        assert!(finder.find(&[[0.0; 3], [0.0, 0.0, 1.0]], 1.0, 1.0).is_some());
    }
}
