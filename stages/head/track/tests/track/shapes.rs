//! Clouds of bodies as a camera at the origin sees them, without noise.

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use stillpoint_rig::head::Head;
use stillpoint_rig::ray::{self, Ray};

/// Where the bodies stand: 0.7 m in front of the camera, turned so that +z of the body looks at it.
pub fn camera_from_body() -> Isometry3<f64> {
    Isometry3::from_parts(
        Vector3::new(0.0, 0.0, 0.7).into(),
        UnitQuaternion::from_axis_angle(&Vector3::x_axis(), core::f64::consts::PI),
    )
}

/// The points of a body seen by rays 2.5 mrad apart. `hit` gives the distance along a ray in the body's frame.
pub fn seen(
    camera_from_body: &Isometry3<f64>,
    hit: impl Fn(&Point3<f64>, &Vector3<f64>) -> Option<f64>,
) -> Vec<Vector3<f64>> {
    let back = camera_from_body.inverse();
    let origin = back * Point3::origin();
    let pixels = (0..160 * 160).map(|i| (i % 160 - 80, i / 160 - 80));
    pixels
        .filter_map(|(u, v)| {
            let direction = Vector3::new(f64::from(u) * 2.5e-3, f64::from(v) * 2.5e-3, 1.0);
            hit(&origin, &(back * direction)).map(|t| direction * t)
        })
        .collect()
}

/// The rig's head.
pub fn head(camera_from_head: &Isometry3<f64>) -> Vec<Vector3<f64>> {
    let head = Head::new(1.0).unwrap();
    seen(camera_from_head, |origin, direction| {
        let ray = Ray { origin: *origin, direction: *direction };
        let hits = head.parts().iter().filter_map(|part| ray::ellipsoid(&ray, part));
        hits.map(|hit| hit.t).min_by(f64::total_cmp)
    })
}

/// A sphere about the body's origin.
pub fn sphere(camera_from_body: &Isometry3<f64>, radius: f64) -> Vec<Vector3<f64>> {
    seen(camera_from_body, |o, d| {
        let (a, b) = (d.norm_squared(), o.coords.dot(d));
        let root = b * b - a * (o.coords.norm_squared() - radius * radius);
        (root > 0.0).then(|| (-b - root.sqrt()) / a)
    })
}

/// A cylinder about the body's y axis, longer than the camera sees.
pub fn cylinder(camera_from_body: &Isometry3<f64>, radius: f64) -> Vec<Vector3<f64>> {
    seen(camera_from_body, |o, d| {
        let (a, b) = (d.x * d.x + d.z * d.z, o.x * d.x + o.z * d.z);
        let root = b * b - a * (o.x * o.x + o.z * o.z - radius * radius);
        (root > 0.0).then(|| (-b - root.sqrt()) / a)
    })
}
