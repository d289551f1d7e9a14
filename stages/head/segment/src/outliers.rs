//! Statistical outlier removal: points that stand apart.
//!
//! The mean distance of a point to its k nearest neighbours has, over the cloud, a mean and a standard deviation. A
//! point whose mean distance exceeds mean + multiple * deviation is an outlier: the alpha of (4.18), which the
//! dissertation took from Rusu (2009).

use crate::neighbours::Neighbours;

/// How outliers are told.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OutlierParams {
    /// Neighbours of a point.
    pub neighbours: usize,
    /// k of (4.18): standard deviations over the mean.
    pub deviations: f64,
    /// Width of the cells that neighbours are looked for in, in metres: about the distance of points.
    pub cell: f64,
}

/// The filter with its buffers; after the first frames of a size it allocates nothing.
#[derive(Debug, Clone, Default)]
pub struct OutlierFilter {
    neighbours: Neighbours,
    found: Vec<(f32, u32)>,
    distances: Vec<f64>,
    retained: Vec<bool>,
}

impl OutlierFilter {
    /// A filter without buffers yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Says for each of `points` (finite, in metres) whether it is kept. One with fewer neighbours near by than asked
    /// for is no more kept than one whose neighbours are far.
    pub fn keep(&mut self, points: &[[f32; 3]], params: &OutlierParams) -> &[bool] {
        self.neighbours.sort(points, params.cell);
        self.distances.clear();
        let (mut count, mut sum, mut squares) = (0.0, 0.0, 0.0);
        for point in 0..points.len() {
            self.neighbours.nearest(points, point, params.neighbours, &mut self.found);
            let mean = if self.found.len() < params.neighbours {
                f64::INFINITY
            } else {
                self.found.iter().map(|(d, _)| f64::from(*d).sqrt()).sum::<f64>() / self.found.len() as f64
            };
            if mean.is_finite() {
                count += 1.0;
                sum += mean;
                squares += mean * mean;
            }
            self.distances.push(mean);
        }
        let alpha = alpha(count, sum, squares, params.deviations);
        self.retained.clear();
        self.retained.extend(self.distances.iter().map(|&distance| distance <= alpha));
        &self.retained
    }
}

/// (4.18): the mean of `count` numbers and `deviations` of their standard deviations, from their sum and that of their
/// squares. 0 for none.
pub(crate) fn alpha(count: f64, sum: f64, squares: f64, deviations: f64) -> f64 {
    if count < 1.0 {
        return 0.0;
    }
    let mean = sum / count;
    mean + deviations * (squares / count - mean * mean).max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    const PARAMS: OutlierParams = OutlierParams { neighbours: 8, deviations: 2.0, cell: 0.01 };

    #[test]
    fn points_that_stand_apart_are_removed_and_no_others() {
        let mut points: Vec<_> =
            (0..2500).map(|i| [(i % 50) as f32 * 0.005, (i / 50) as f32 * 0.005, 1.0]).collect();
        // One between the surface and the camera, and one that is alone.
        points.push([0.1, 0.1, 0.98]);
        points.push([0.1, 0.1, 0.5]);
        let mut filter = OutlierFilter::new();
        let retained = filter.keep(&points, &PARAMS);
        assert!(!retained[2500] && !retained[2501]);
        // At the rim the neighbours are on one side only, and so farther.
        let inside = |i: usize| (3..47).contains(&(i % 50)) && (3..47).contains(&(i / 50));
        assert!((0..2500).filter(|&i| inside(i)).all(|i| retained[i]));
    }

    #[test]
    fn few_points_are_all_outliers() {
        let mut filter = OutlierFilter::new();
        assert!(filter.keep(&[], &PARAMS).is_empty());
        assert_eq!(filter.keep(&[[0.0, 0.0, 1.0]; 3], &PARAMS), [false; 3]);
    }

    #[test]
    fn alpha_is_the_mean_and_k_deviations() {
        let values = [1.0, 2.0, 3.0, 6.0];
        let (sum, squares) = (12.0, values.iter().map(|v| v * v).sum());
        // Mean 3, variance (4 + 1 + 0 + 9) / 4.
        assert!((alpha(4.0, sum, squares, 2.0) - (3.0 + 2.0 * 3.5_f64.sqrt())).abs() < 1e-12);
    }
}
