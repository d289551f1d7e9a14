//! A pinhole camera: intrinsics that cannot be degenerate, and its place over the couch.
//!
//! Camera frame: x to the right of the image, y down, z forward along the optical axis.
//! A pixel (u, v) sees along ((u - cx) / fx, (v - cy) / fy, 1): the middle of the first pixel is (0, 0).

use nalgebra::{Isometry3, Quaternion, Translation3, Unit, UnitQuaternion, Vector3};

/// Why intrinsics are refused.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum PinholeError {
    /// A focal length that no camera has.
    #[error("focal length {name} is {value} px; give a number from 1 to 1e6")]
    Focal {
        /// `fx` or `fy`.
        name: &'static str,
        /// The value given, in pixels.
        value: f64,
    },
    /// A principal point that is not near the image.
    #[error("principal point {name} is {value} px; give a number from -1e5 to 1e5")]
    PrincipalPoint {
        /// `cx` or `cy`.
        name: &'static str,
        /// The value given, in pixels.
        value: f64,
    },
    /// An image size of zero, or too large.
    #[error("image {name} is {value} px; give a number from 1 to 8192")]
    Size {
        /// `width` or `height`.
        name: &'static str,
        /// The value given, in pixels.
        value: usize,
    },
}

/// Pinhole intrinsics without distortion, in pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pinhole {
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    width: usize,
    height: usize,
}

impl Pinhole {
    /// Checks and holds intrinsics: focal lengths, principal point and image size, all in pixels.
    ///
    /// # Errors
    /// [`PinholeError`] names the first number that is not finite or out of range.
    pub fn new(
        fx: f64,
        fy: f64,
        cx: f64,
        cy: f64,
        width: usize,
        height: usize,
    ) -> Result<Self, PinholeError> {
        for (name, value) in [("fx", fx), ("fy", fy)] {
            if !(1.0..=1e6).contains(&value) {
                return Err(PinholeError::Focal { name, value });
            }
        }
        for (name, value) in [("cx", cx), ("cy", cy)] {
            if !(-1e5..=1e5).contains(&value) {
                return Err(PinholeError::PrincipalPoint { name, value });
            }
        }
        for (name, value) in [("width", width), ("height", height)] {
            if !(1..=8192).contains(&value) {
                return Err(PinholeError::Size { name, value });
            }
        }
        Ok(Self { fx, fy, cx, cy, width, height })
    }

    /// Horizontal focal length in pixels.
    pub fn fx(&self) -> f64 {
        self.fx
    }

    /// Vertical focal length in pixels.
    pub fn fy(&self) -> f64 {
        self.fy
    }

    /// Column of the principal point in pixels.
    pub fn cx(&self) -> f64 {
        self.cx
    }

    /// Row of the principal point in pixels.
    pub fn cy(&self) -> f64 {
        self.cy
    }

    /// Columns of the image.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows of the image.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Pixels of the image.
    pub fn pixels(&self) -> usize {
        self.width * self.height
    }

    /// The direction that column `u` and row `v` see, in the camera frame, with z = 1.
    /// The parameter of a point on that ray is therefore its depth.
    pub fn direction(&self, u: usize, v: usize) -> Vector3<f64> {
        Vector3::new((u as f64 - self.cx) / self.fx, (v as f64 - self.cy) / self.fy, 1.0)
    }

    /// Where a point of the camera frame appears, as (u, v) in pixels; `None` at or behind the camera.
    pub fn project(&self, camera_point: &Vector3<f64>) -> Option<(f64, f64)> {
        let z = camera_point.z;
        (z > 0.0).then(|| (self.fx * camera_point.x / z + self.cx, self.fy * camera_point.y / z + self.cy))
    }
}

/// The pose of a camera over the couch, from its place (metres) and three angles (radians).
///
/// At angles of zero the camera looks straight down with the head end at the top of the image
/// (x along the couch's x, y towards the feet, z down: a half turn about the couch's x).
/// The angles turn it from there, about its own axes at zero, x first, then y, then z:
/// `couch_from_camera = T(at) Rx(pi) Rz(c) Ry(b) Rx(a)`.
/// So a camera at the feet, at (0, -0.45, 0.45), turned by (45 deg, 0, 0) looks up the couch at its origin.
/// With axes that coincide at zero, as frames of other kinds have them, the same pose is (-135 deg, 0, 0).
pub fn couch_from_camera(at: Vector3<f64>, angles: [f64; 3]) -> Isometry3<f64> {
    let half_turn_about_x = Unit::new_unchecked(Quaternion::new(0.0, 1.0, 0.0, 0.0));
    let turn = UnitQuaternion::from_euler_angles(angles[0], angles[1], angles[2]);
    Isometry3::from_parts(Translation3::from(at), half_turn_about_x * turn)
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::FRAC_PI_4;
    use nalgebra::Point3;
    use proptest::prelude::*;

    fn not_a_focal_length() -> impl Strategy<Value = f64> {
        prop_oneof![
            Just(f64::NAN),
            Just(f64::INFINITY),
            Just(f64::NEG_INFINITY),
            Just(0.0),
            Just(f64::MIN_POSITIVE),
            -1e9..0.999f64,
            1.1e6..1e300f64,
        ]
    }

    proptest! {
        #[test]
        fn a_degenerate_focal_length_is_refused_by_name(bad in not_a_focal_length(), second in any::<bool>()) {
            let (fx, fy, name) = if second { (566.0, bad, "fy") } else { (bad, 566.0, "fx") };
            let message = Pinhole::new(fx, fy, 319.5, 239.5, 640, 480).unwrap_err().to_string();
            prop_assert!(message.contains(&format!("focal length {name} is {bad} px")), "{}", message);
        }

        #[test]
        fn a_principal_point_far_away_or_not_finite_is_refused_by_name(
            bad in prop_oneof![Just(f64::NAN), Just(f64::INFINITY), 1.1e5..1e300f64],
            second in any::<bool>(),
        ) {
            let (cx, cy, name) = if second { (319.5, bad, "cy") } else { (bad, 239.5, "cx") };
            let message = Pinhole::new(566.0, 566.0, cx, cy, 640, 480).unwrap_err().to_string();
            prop_assert!(message.contains(&format!("principal point {name} is {bad} px")), "{}", message);
        }

        #[test]
        fn what_a_pixel_sees_projects_back_onto_it(u in 0usize..640, v in 0usize..480, z in 0.1..5.0f64) {
            let camera = Pinhole::new(566.0, 570.0, 319.5, 239.5, 640, 480).unwrap();
            let (x, y) = camera.project(&(camera.direction(u, v) * z)).unwrap();
            prop_assert!((x - u as f64).abs() < 1e-9 && (y - v as f64).abs() < 1e-9);
        }
    }

    #[test]
    fn an_empty_image_is_refused_by_name() {
        let error = Pinhole::new(566.0, 566.0, 319.5, 239.5, 640, 0).unwrap_err();
        assert_eq!(error.to_string(), "image height is 0 px; give a number from 1 to 8192");
    }

    #[test]
    fn a_camera_at_the_feet_turned_by_45_degrees_looks_at_the_couch_origin() {
        let pose = couch_from_camera(Vector3::new(0.0, -0.45, 0.45), [FRAC_PI_4, 0.0, 0.0]);
        let camera_origin = pose.inverse_transform_point(&Point3::origin());
        let expected = Vector3::new(0.0, 0.0, 0.45 * core::f64::consts::SQRT_2);
        assert!((camera_origin.coords - expected).norm() < 1e-12, "{camera_origin}");
    }

    #[test]
    fn the_patients_left_is_right_in_the_image_and_the_head_end_is_up() {
        let pose = couch_from_camera(Vector3::new(0.0, -0.45, 0.45), [FRAC_PI_4, 0.0, 0.0]);
        let left = pose.inverse_transform_vector(&Vector3::x());
        let head_end = pose.inverse_transform_vector(&Vector3::y());
        assert!((left - Vector3::x()).norm() < 1e-12);
        assert!(head_end.y < -0.7);
    }
}
