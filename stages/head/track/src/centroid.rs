//! Centroid of a cloud and the covariance of that centroid.

use nalgebra::{Matrix3, Vector3};

/// The mean of a cloud's points, in the cloud's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Centroid {
    /// Mean in metres.
    pub position: Vector3<f64>,
    /// Covariance of the mean in square metres: the points' sample covariance over their number. It includes the spread
    /// of the points over the surface, so it is an upper bound for noise that is independent from point to point. It
    /// does not include an error that all points share.
    pub covariance: Matrix3<f64>,
    /// Finite points averaged.
    pub count: usize,
}

/// The centroid of the finite points of `points` (metres), summed in their order; `None` for fewer than two.
///
/// mean = sum p / n, covariance of the mean = sum (p - mean)(p - mean)^T / (n (n - 1)).
pub fn centroid(points: impl IntoIterator<Item = [f32; 3]>) -> Option<Centroid> {
    let finite = |p: &[f32; 3]| p.iter().all(|c| c.is_finite());
    let mut points =
        points.into_iter().filter(finite).map(|[x, y, z]| Vector3::new(x.into(), y.into(), z.into()));
    // Sums about a point of the cloud keep the digits of a small cloud far from the origin.
    let origin: Vector3<f64> = points.next()?;
    let (mut count, mut sum, mut squares) = (1_usize, Vector3::zeros(), Matrix3::zeros());
    for point in points {
        let d = point - origin;
        count += 1;
        sum += d;
        squares += d * d.transpose();
    }
    if count < 2 {
        return None;
    }
    let n = count as f64;
    let mean = sum / n;
    let scatter = squares - mean * mean.transpose() * n;
    Some(Centroid { position: origin + mean, covariance: scatter / (n * (n - 1.0)), count })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn centroid_is_the_mean_and_its_variance_the_points_over_their_number() {
        let c = centroid([[1.0, 0.0, 2.0], [3.0, 0.0, 2.0], [1.0, 1.0, 2.0], [3.0, 1.0, 2.0]]).unwrap();
        assert_eq!((c.position, c.count), (Vector3::new(2.0, 0.5, 2.0), 4));
        let expected = Matrix3::from_diagonal(&Vector3::new(1.0 / 3.0, 1.0 / 12.0, 0.0));
        assert!((c.covariance - expected).norm() < 1e-15, "{}", c.covariance);
    }

    #[test]
    fn points_that_are_not_finite_do_not_count() {
        let c =
            centroid([[f32::NAN; 3], [1.0, 0.0, 0.0], [0.0, f32::INFINITY, 0.0], [2.0, 0.0, 0.0]]).unwrap();
        assert_eq!((c.position.x, c.count), (1.5, 2));
    }

    #[test]
    fn one_point_has_no_covariance() {
        assert_eq!(centroid([]), None);
        assert_eq!(centroid([[1.0, 2.0, 3.0]]), None);
    }

    #[test]
    fn small_cloud_far_away_keeps_its_digits() {
        let step = 1.0 / 1024.0;
        let c = centroid((0..5).map(|i| [1000.0 + i as f32 * step, 0.0, 1000.0])).unwrap();
        // Variance of 0..4 is 2.5; over five points 0.5.
        let expected = 0.5 * f64::from(step * step);
        assert!((c.covariance[(0, 0)] / expected - 1.0).abs() < 1e-9);
    }
}
