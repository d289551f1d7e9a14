//! How high the highest place of a cloud is: one coordinate, as the source's distance to the forehead (4.2.2).
//!
//! The highest points alone would be those whose noise is highest. So they only say where the place is; its height is
//! the mean of all points within a radius about it, which noise moves by its mean alone.

/// The highest patch of a cloud.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Summit {
    /// Mean of the patch, m: across, across, and along the axis that is looked at.
    pub position: [f64; 3],
    /// Variance of the height, m2: that of the patch's points over their number. It has the slope of the surface in it,
    /// and nothing of an error that all points share.
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
    /// The summit of points whose third coordinate is the height, m: the mean place of the highest `share` of them, and
    /// the points within `radius` (m, across) of it. `None` where fewer than two are.
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
        let across = mean(points.clone().filter(|p| p[2] >= least))?.0;
        let near = |p: &[f32; 3]| {
            let (dx, dy) = (f64::from(p[0]) - across[0], f64::from(p[1]) - across[1]);
            dx * dx + dy * dy <= radius * radius
        };
        let (position, count) = mean(points.clone().filter(near))?;
        if count < 2 {
            return None;
        }
        let squares: f64 = points.filter(near).map(|p| (f64::from(p[2]) - position[2]).powi(2)).sum();
        let n = count as f64;
        Some(Summit { position, variance: squares / (n * (n - 1.0)), count })
    }
}

/// Mean and number of points, summed in their order.
fn mean(points: impl Iterator<Item = [f32; 3]>) -> Option<([f64; 3], usize)> {
    let (mut sum, mut count) = ([0.0; 3], 0_usize);
    for p in points {
        (0..3).for_each(|i| sum[i] += f64::from(p[i]));
        count += 1;
    }
    (count > 0).then(|| (sum.map(|s| s / count as f64), count))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A dome of 100 mm radius whose top is at (10, -20, 150) mm, in steps of 1 mm, with a saw-tooth of noise.
    fn dome(noise: f32) -> Vec<[f32; 3]> {
        let mut points = Vec::new();
        for i in -60..=60_i32 {
            for j in -60..=60_i32 {
                let (x, y) = (i as f32 * 1e-3, j as f32 * 1e-3);
                let z = 0.05 + (0.01 - x * x - y * y).sqrt();
                let saw = ((i * 31 + j * 17).rem_euclid(101) as f32 / 50.0 - 1.0) * noise;
                points.push([x + 0.01, y - 0.02, z + saw]);
            }
        }
        points
    }

    #[test]
    fn summit_of_a_dome_is_its_top() {
        let found = SummitFinder::default().find(&dome(0.0), 0.01, 0.00505).unwrap();
        assert!((found.position[0] - 0.01).abs() < 1e-4 && (found.position[1] + 0.02).abs() < 1e-4);
        // The mean height over a patch of 5 mm is 62 um below the top.
        assert!((found.position[2] - 0.15).abs() < 1e-4, "{found:?}");
        assert_eq!(found.count, 81);
    }

    #[test]
    fn noise_does_not_lift_the_summit() {
        let find = |noise| SummitFinder::default().find(&dome(noise), 0.05, 0.00505).unwrap();
        let (quiet, noisy) = (find(0.0), find(3e-3));
        // The highest points are 3 mm too high; their neighbourhood is not.
        assert!((noisy.position[2] - quiet.position[2]).abs() < 5e-4, "{noisy:?}");
        // A saw-tooth of 3 mm has a deviation of 1.7 mm; 81 points know their mean to 0.2 mm.
        assert!((noisy.variance.sqrt() - 1.75e-3 / 9.0).abs() < 5e-5, "{}", noisy.variance.sqrt());
    }

    #[test]
    fn cloud_without_two_finite_points_has_no_summit() {
        let mut finder = SummitFinder::default();
        assert_eq!(finder.find(&[], 0.1, 1.0), None);
        assert_eq!(finder.find(&[[0.0; 3], [f32::NAN; 3], [0.0, f32::INFINITY, 0.0]], 0.1, 1.0), None);
        assert!(finder.find(&[[0.0; 3], [0.0, 0.0, 1.0]], 1.0, 1.0).is_some());
    }
}
