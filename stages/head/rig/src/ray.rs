//! One ray against one shape, in closed form.
//!
//! The parameter `t` counts in multiples of the ray's direction.
//! With directions from [`crate::camera::Pinhole::direction`], z = 1, `t` is the depth in metres.

use nalgebra::{Point3, Vector3};

use crate::shape::{Cuboid, Ellipsoid};

/// A half line in some frame; the direction need not have unit length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Where the ray starts, in metres.
    pub origin: Point3<f64>,
    pub direction: Vector3<f64>,
}

/// Where a ray meets a surface first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// The ray's parameter at the surface, above zero.
    pub t: f64,
    /// Cosine of the angle between the ray and the surface's normal, from 0 (grazing) to 1 (head-on).
    pub cosine: f64,
}

/// The first point of an ellipsoid from outside it; `None` from inside, or where the ray passes by.
/// Ray and ellipsoid in the same frame.
pub fn ellipsoid(ray: &Ray, shape: &Ellipsoid) -> Option<Hit> {
    let axes = shape.semi_axes();
    // Scaled by the semi-axes the ellipsoid is the unit sphere, and t stays what it was.
    let o = shape.parent_from_shape().inverse_transform_point(&ray.origin).coords.component_div(axes);
    let direction = shape.parent_from_shape().inverse_transform_vector(&ray.direction);
    let d = direction.component_div(axes);
    let (a, b, c) = (d.norm_squared(), o.dot(&d), o.norm_squared() - 1.0);
    let discriminant = b * b - a * c;
    if discriminant < 0.0 || c <= 0.0 {
        return None;
    }
    let t = (-b - discriminant.sqrt()) / a;
    (t > 0.0).then(|| {
        let normal = (o + d * t).component_div(axes);
        Hit { t, cosine: (normal.dot(&direction) / (normal.norm() * direction.norm())).abs() }
    })
}

/// The first point of a cuboid from outside it; `None` from inside, or where the ray passes by.
/// Ray and cuboid in the same frame.
pub fn cuboid(ray: &Ray, shape: &Cuboid) -> Option<Hit> {
    let o = shape.parent_from_shape().inverse_transform_point(&ray.origin);
    let d = shape.parent_from_shape().inverse_transform_vector(&ray.direction);
    let half = shape.half_sizes();
    let (mut enter, mut leave, mut entered_across) = (f64::NEG_INFINITY, f64::INFINITY, 0);
    for axis in 0..3 {
        if d[axis] == 0.0 {
            // Parallel to this pair of faces: between them for ever, or never.
            if o[axis].abs() > half[axis] {
                return None;
            }
            continue;
        }
        let (t0, t1) = ((-half[axis] - o[axis]) / d[axis], (half[axis] - o[axis]) / d[axis]);
        let (near, far) = if t0 < t1 { (t0, t1) } else { (t1, t0) };
        if near > enter {
            (enter, entered_across) = (near, axis);
        }
        leave = leave.min(far);
    }
    (enter <= leave && enter > 0.0)
        .then(|| Hit { t: enter, cosine: d[entered_across].abs() / ray.direction.norm() })
}

/// Where a ray meets the horizontal plane at height `z` (metres); `None` when it never does.
pub fn horizontal_plane(ray: &Ray, z: f64) -> Option<Hit> {
    let t = (z - ray.origin.z) / ray.direction.z;
    (t.is_finite() && t > 0.0).then(|| Hit { t, cosine: ray.direction.z.abs() / ray.direction.norm() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, Translation3, UnitQuaternion};
    use proptest::prelude::*;

    fn ray(origin: [f64; 3], direction: [f64; 3]) -> Ray {
        Ray { origin: Point3::from(origin), direction: Vector3::from(direction) }
    }

    fn turned(at: [f64; 3], angles: [f64; 3]) -> Isometry3<f64> {
        let rotation = UnitQuaternion::from_euler_angles(angles[0], angles[1], angles[2]);
        Isometry3::from_parts(Translation3::new(at[0], at[1], at[2]), rotation)
    }

    #[test]
    fn a_sphere_head_on_is_nearer_by_its_radius() {
        let sphere = Ellipsoid::new(Isometry3::translation(0.0, 0.0, 0.7), Vector3::repeat(0.1)).unwrap();
        let hit = ellipsoid(&ray([0.0; 3], [0.0, 0.0, 1.0]), &sphere).unwrap();
        assert!((hit.t - 0.6).abs() < 1e-12);
        assert!((hit.cosine - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_cuboid_head_on_is_nearer_by_half_its_size() {
        let shape = Cuboid::new(Isometry3::translation(0.0, 0.0, 0.7), Vector3::new(0.1, 0.1, 0.05)).unwrap();
        let hit = cuboid(&ray([0.0; 3], [0.0, 0.0, 1.0]), &shape).unwrap();
        assert!((hit.t - 0.65).abs() < 1e-12);
        assert!((hit.cosine - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_plane_seen_at_45_degrees_is_at_the_height_times_root_two() {
        let hit = horizontal_plane(&ray([0.0, 0.0, 0.5], [0.0, 1.0, -1.0]), 0.0).unwrap();
        assert!((hit.t - 0.5).abs() < 1e-12);
        assert!((hit.cosine - core::f64::consts::FRAC_1_SQRT_2).abs() < 1e-12);
    }

    #[test]
    fn a_ray_along_a_plane_never_meets_it() {
        assert_eq!(horizontal_plane(&ray([0.0, 0.0, 0.5], [1.0, 0.0, 0.0]), 0.5), None);
        assert_eq!(horizontal_plane(&ray([0.0, 0.0, 0.5], [1.0, 0.0, 0.0]), 0.0), None);
    }

    #[test]
    fn shapes_behind_the_ray_are_not_seen() {
        let pose = Isometry3::translation(0.0, 0.0, -0.7);
        let away = ray([0.0; 3], [0.0, 0.0, 1.0]);
        assert_eq!(ellipsoid(&away, &Ellipsoid::new(pose, Vector3::repeat(0.1)).unwrap()), None);
        assert_eq!(cuboid(&away, &Cuboid::new(pose, Vector3::repeat(0.1)).unwrap()), None);
    }

    proptest! {
        #[test]
        fn a_hit_on_an_ellipsoid_satisfies_its_equation(
            at in prop::array::uniform3(-0.1..0.1f64),
            angles in prop::array::uniform3(-3.0..3.0f64),
            axes in prop::array::uniform3(0.02..0.2f64),
            x in -0.3..0.3f64,
            y in -0.3..0.3f64,
        ) {
            let pose = turned([at[0], at[1], at[2] + 0.7], angles);
            let shape = Ellipsoid::new(pose, Vector3::from(axes)).unwrap();
            let towards = ray([0.0; 3], [x, y, 1.0]);
            if let Some(hit) = ellipsoid(&towards, &shape) {
                let on_surface = pose.inverse_transform_point(&(towards.origin + towards.direction * hit.t));
                let value = on_surface.coords.component_div(&Vector3::from(axes)).norm_squared();
                prop_assert!((value - 1.0).abs() < 1e-9, "{}", value);
                prop_assert!((0.0..=1.0 + 1e-12).contains(&hit.cosine));
            }
        }

        #[test]
        fn a_hit_on_a_cuboid_lies_on_a_face(
            angles in prop::array::uniform3(-3.0..3.0f64),
            half in prop::array::uniform3(0.02..0.2f64),
            x in -0.3..0.3f64,
            y in -0.3..0.3f64,
        ) {
            let pose = turned([0.0, 0.0, 0.8], angles);
            let shape = Cuboid::new(pose, Vector3::from(half)).unwrap();
            let towards = ray([0.0; 3], [x, y, 1.0]);
            if let Some(hit) = cuboid(&towards, &shape) {
                let on_surface = pose.inverse_transform_point(&(towards.origin + towards.direction * hit.t));
                let outermost = on_surface.coords.component_div(&Vector3::from(half)).amax();
                prop_assert!((outermost - 1.0).abs() < 1e-9, "{}", outermost);
            }
        }
    }
}
