//! A plane in Hesse normal form and its least-squares fit.

use nalgebra::{Matrix3, Vector3};

/// The points p with `normal · p + offset = 0`; the origin (the camera) is on the side that the normal points to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// Unit normal, toward the origin's side.
    pub normal: Vector3<f64>,
    /// Distance of the origin from the plane in metres, not negative.
    pub offset: f64,
}

/// A point in double precision.
#[inline]
pub(crate) fn vector(point: [f32; 3]) -> Vector3<f64> {
    Vector3::new(f64::from(point[0]), f64::from(point[1]), f64::from(point[2]))
}

impl Plane {
    /// The plane through `point` across `normal` (of any length but 0).
    #[must_use]
    pub fn from_point_normal(point: &Vector3<f64>, normal: &Vector3<f64>) -> Option<Self> {
        let length = normal.norm();
        // Written so that NaN is refused.
        if !(length > 0.0 && length.is_finite()) {
            return None;
        }
        let normal = normal / length;
        let offset = -normal.dot(point);
        if !offset.is_finite() {
            return None;
        }
        Some(if offset < 0.0 { Self { normal: -normal, offset: -offset } } else { Self { normal, offset } })
    }

    /// The plane through three points, `None` where they lie nearly in line (the sine of an angle below 1e-3).
    #[must_use]
    pub fn through(a: [f32; 3], b: [f32; 3], c: [f32; 3]) -> Option<Self> {
        let (a, b, c) = (vector(a), vector(b), vector(c));
        let (ab, ac) = (b - a, c - a);
        let normal = ab.cross(&ac);
        let straight = ab.norm_squared() * ac.norm_squared() * 1e-6;
        if normal.norm_squared() > straight { Self::from_point_normal(&a, &normal) } else { None }
    }

    /// The plane with the least sum of squared distances to `points`, summed in their order. `None` for fewer than three
    /// points or points in line.
    #[must_use]
    pub fn fit(points: impl IntoIterator<Item = [f32; 3]>) -> Option<Self> {
        let mut sums = PlaneSums::default();
        points.into_iter().for_each(|point| sums.add(point));
        sums.plane()
    }

    /// Signed distance of `point` in metres, positive on the origin's side.
    #[inline]
    #[must_use]
    pub fn height(&self, point: [f32; 3]) -> f64 {
        self.normal.dot(&vector(point)) + self.offset
    }

    /// The angle between the normals of two planes, in radians.
    #[must_use]
    pub fn angle_to(&self, other: &Self) -> f64 {
        // The arc tangent keeps small angles, which the arc cosine loses.
        libm::atan2(self.normal.cross(&other.normal).norm(), self.normal.dot(&other.normal))
    }

    /// Two unit vectors that span the plane, right-handed with the normal.
    #[must_use]
    pub fn axes(&self) -> (Vector3<f64>, Vector3<f64>) {
        let thinnest = self.normal.iamin();
        let mut along = Vector3::zeros();
        along[thinnest] = 1.0;
        let u = self.normal.cross(&along).normalize();
        (u, self.normal.cross(&u))
    }
}

/// Sums over points from which their plane follows. They are about the first point: so they keep their digits far from the
/// origin.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct PlaneSums {
    origin: Vector3<f64>,
    count: usize,
    sum: Vector3<f64>,
    /// xx, xy, xz, yy, yz, zz.
    products: [f64; 6],
}

impl PlaneSums {
    #[inline]
    pub fn add(&mut self, point: [f32; 3]) {
        let point = vector(point);
        if self.count == 0 {
            self.origin = point;
        }
        let d = point - self.origin;
        self.count += 1;
        self.sum += d;
        let products = [d.x * d.x, d.x * d.y, d.x * d.z, d.y * d.y, d.y * d.z, d.z * d.z];
        for (sum, product) in self.products.iter_mut().zip(products) {
            *sum += product;
        }
    }

    pub fn count(&self) -> usize {
        self.count
    }

    /// The plane across the eigenvector of the least eigenvalue of the points' covariance.
    pub fn plane(&self) -> Option<Plane> {
        if self.count < 3 {
            return None;
        }
        let count = self.count as f64;
        let mean = self.sum / count;
        let [xx, xy, xz, yy, yz, zz] = self.products;
        let second = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz) / count;
        let covariance = second - mean * mean.transpose();
        // The eigenvalue iteration is not promised to end for NaN.
        if covariance.iter().any(|c| !c.is_finite()) {
            return None;
        }
        let eigen = covariance.symmetric_eigen();
        let [smallest, middle, largest] = ascending(&eigen.eigenvalues);
        // Points in line leave the normal open.
        if eigen.eigenvalues[middle] <= 1e-9 * eigen.eigenvalues[largest] {
            return None;
        }
        let normal = eigen.eigenvectors.column(smallest).into_owned();
        Plane::from_point_normal(&(self.origin + mean), &normal)
    }
}

/// The places of three values from the least to the greatest.
fn ascending(values: &Vector3<f64>) -> [usize; 3] {
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(height: impl Fn(f32, f32) -> f32) -> Vec<[f32; 3]> {
        (0..400)
            .map(|i| ((i % 20) as f32 * 0.05, (i / 20) as f32 * 0.05))
            .map(|(x, y)| [x, y, height(x, y)])
            .collect()
    }

    #[test]
    fn fit_finds_the_plane_that_points_lie_on() {
        let plane = Plane::fit(grid(|x, y| 2.0 + 0.5 * x - 0.25 * y)).unwrap();
        let true_normal = Vector3::new(0.5, -0.25, -1.0).normalize();
        assert!((plane.normal - true_normal).norm() < 1e-6, "{plane:?}");
        assert!((plane.offset - 2.0 / 1.3125_f64.sqrt()).abs() < 1e-6);
    }

    #[test]
    fn normal_points_to_the_camera() {
        let plane = Plane::through([0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]).unwrap();
        assert_eq!((plane.normal, plane.offset), (Vector3::new(0.0, 0.0, -1.0), 1.0));
        assert_eq!(plane.height([0.3, 0.2, 0.75]), 0.25);
    }

    #[test]
    fn points_in_line_make_no_plane() {
        assert_eq!(Plane::through([0.0, 0.0, 1.0], [0.5, 0.0, 1.0], [1.0, 1e-5, 1.0]), None);
        assert_eq!(Plane::fit((0..50).map(|i| [i as f32 * 0.1, 0.0, 1.0])), None);
        assert_eq!(Plane::fit([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), None);
        assert_eq!(Plane::fit([[f32::NAN; 3]; 5]), None);
    }

    #[test]
    fn axes_are_orthonormal_and_right_handed() {
        let plane = Plane::fit(grid(|x, y| 1.0 + 0.3 * x + 0.9 * y)).unwrap();
        let (u, v) = plane.axes();
        assert!((u.cross(&v) - plane.normal).norm() < 1e-12);
        assert!(u.dot(&v).abs() < 1e-12);
    }
}
