//! An ellipsoid as a pinhole camera sees it, prepared so that a row of pixels is cheap.
//!
//! With d = (x, y, 1) the direction of a pixel, an ellipsoid (p - c)' Q (p - c) = 1 is met at depth
//! t = (-b - sqrt(D)) / a with a = d'Qd, b = -(Qc)'d and D = d'Md, M = (Qc)(Qc)' - (c'Qc - 1) Q.
//! All three are polynomials in x along a row, and the roots of D are the silhouette.

use core::ops::Range;

use nalgebra::{Isometry3, Matrix3, Vector3};

use crate::camera::Pinhole;
use crate::shape::Ellipsoid;

/// An ellipsoid in the camera frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quadric {
    q: Matrix3<f64>,
    m: Matrix3<f64>,
    q_c: Vector3<f64>,
}

/// What a [`Quadric`] becomes on one row of the image: three polynomials in x.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RowQuadric {
    a: [f64; 3],
    b: [f64; 2],
    discriminant: [f64; 3],
}

impl Quadric {
    /// The ellipsoid as the camera sees it; `camera_from_parent` takes the ellipsoid's parent frame to the
    /// camera's. `None` when the camera is inside the ellipsoid, from where it is not seen.
    pub fn new(camera_from_parent: &Isometry3<f64>, shape: &Ellipsoid) -> Option<Self> {
        let pose = camera_from_parent * shape.parent_from_shape();
        let rotation = pose.rotation.to_rotation_matrix().into_inner();
        let inverse_squares = shape.semi_axes().map(|axis| 1.0 / (axis * axis));
        let q = rotation * Matrix3::from_diagonal(&inverse_squares) * rotation.transpose();
        let centre = pose.translation.vector;
        let q_c = q * centre;
        let outside = centre.dot(&q_c) - 1.0;
        (outside > 0.0).then(|| Self { q, m: q_c * q_c.transpose() - q * outside, q_c })
    }

    /// The polynomials on the row whose pixels have direction (x, `y`, 1).
    pub fn on_row(&self, y: f64) -> RowQuadric {
        let quadratic = |s: &Matrix3<f64>| {
            let constant = (s[(1, 1)] * y + 2.0 * s[(1, 2)]) * y + s[(2, 2)];
            [constant, 2.0 * (s[(0, 1)] * y + s[(0, 2)]), s[(0, 0)]]
        };
        RowQuadric {
            a: quadratic(&self.q),
            b: [-(self.q_c.y * y + self.q_c.z), -self.q_c.x],
            discriminant: quadratic(&self.m),
        }
    }

    /// Cosine of the angle between the ray along (`x`, `y`, 1) and the surface's normal at depth `t`.
    pub fn cosine(&self, x: f64, y: f64, t: f64) -> f64 {
        let d = Vector3::new(x, y, 1.0);
        let normal = self.q * d * t - self.q_c;
        (normal.dot(&d) * normal.dot(&d) / (normal.norm_squared() * d.norm_squared())).sqrt()
    }
}

impl RowQuadric {
    /// The columns on which the ellipsoid can be seen; outside them it is not. Empty when there are none.
    pub fn columns(&self, camera: &Pinhole) -> Range<usize> {
        let [c, b, a] = self.discriminant;
        let whole_row = 0..camera.width();
        if a >= 0.0 {
            // The ellipsoid reaches through the camera's own plane: its outline is no ellipse.
            return whole_row;
        }
        let inner = b * b - 4.0 * a * c;
        if inner.is_nan() || inner < 0.0 {
            return 0..0;
        }
        let column = |root: f64| camera.fx() * root + camera.cx();
        let first = column((-b + inner.sqrt()) / (2.0 * a)).ceil().max(0.0) as usize;
        let last = column((-b - inner.sqrt()) / (2.0 * a)).floor();
        if last < 0.0 {
            return 0..0;
        }
        first..(last as usize + 1).min(whole_row.end)
    }

    /// The depth at which the ray along (`x`, y, 1) meets the ellipsoid, in metres.
    /// NaN where it passes by, negative where the ellipsoid is behind the camera.
    #[inline]
    pub fn depth(&self, x: f64) -> f64 {
        let a = (self.a[2] * x + self.a[1]) * x + self.a[0];
        let b = self.b[1] * x + self.b[0];
        let [d0, d1, d2] = self.discriminant;
        (-b - ((d2 * x + d1) * x + d0).sqrt()) / a
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ray::{self, Ray};
    use nalgebra::{Point3, Translation3, UnitQuaternion};
    use proptest::prelude::*;

    fn camera() -> Pinhole {
        Pinhole::new(566.0, 566.0, 319.5, 239.5, 640, 480).unwrap()
    }

    proptest! {
        #[test]
        fn a_row_of_the_image_gives_what_its_rays_give(
            at in prop::array::uniform3(-0.3..0.3f64),
            angles in prop::array::uniform3(-3.0..3.0f64),
            axes in prop::array::uniform3(0.01..0.12f64),
            v in 0usize..480,
        ) {
            let rotation = UnitQuaternion::from_euler_angles(angles[0], angles[1], angles[2]);
            let pose = Isometry3::from_parts(Translation3::new(at[0], at[1], at[2] + 0.8), rotation);
            let shape = Ellipsoid::new(pose, Vector3::from(axes)).unwrap();
            let quadric = Quadric::new(&Isometry3::identity(), &shape).unwrap();
            let row = quadric.on_row(camera().direction(0, v).y);
            let columns = row.columns(&camera());
            for u in 0..640 {
                let direction = camera().direction(u, v);
                let hit = ray::ellipsoid(&Ray { origin: Point3::origin(), direction }, &shape);
                // At grazing incidence the depth is a square root of nearly nothing, in both ways.
                if let Some(hit) = hit.filter(|hit| hit.cosine > 1e-3) {
                    prop_assert!(columns.contains(&u));
                    prop_assert!((row.depth(direction.x) - hit.t).abs() < 1e-9);
                    prop_assert!((quadric.cosine(direction.x, direction.y, hit.t) - hit.cosine).abs() < 1e-9);
                } else if hit.is_none() && columns.contains(&u) {
                    let t = row.depth(direction.x);
                    prop_assert!(t.is_nan() || quadric.cosine(direction.x, direction.y, t) < 1e-3);
                }
            }
        }
    }

    #[test]
    fn a_sphere_head_on_is_nearer_by_its_radius() {
        let sphere = Ellipsoid::new(Isometry3::translation(0.0, 0.0, 0.7), Vector3::repeat(0.1)).unwrap();
        let quadric = Quadric::new(&Isometry3::identity(), &sphere).unwrap();
        assert!((quadric.on_row(0.0).depth(0.0) - 0.6).abs() < 1e-12);
    }

    #[test]
    fn an_ellipsoid_around_the_camera_is_not_seen() {
        let around = Ellipsoid::new(Isometry3::translation(0.0, 0.0, 0.05), Vector3::repeat(0.1)).unwrap();
        assert_eq!(Quadric::new(&Isometry3::identity(), &around), None);
    }

    #[test]
    fn an_ellipsoid_behind_the_camera_has_no_depth_in_front_of_it() {
        let behind = Ellipsoid::new(Isometry3::translation(0.0, 0.0, -0.5), Vector3::repeat(0.1)).unwrap();
        let row = Quadric::new(&Isometry3::identity(), &behind).unwrap().on_row(0.0);
        assert!(row.depth(0.0) < 0.0);
    }
}
