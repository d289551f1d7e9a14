//! The cameras over a drawn patient.

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::camera::{Pinhole, PinholeError};
use crate::noise::NoiseParams;

/// A kind of camera: focal length and size in pixels, errors.
#[derive(Debug, Clone, Copy)]
pub struct Kind {
    pub name: &'static str,
    /// Focal length, px.
    pub focal: f64,
    pub size: [usize; 2],
    pub noise: fn() -> NoiseParams,
}

/// An industrial camera with projected texture.
pub const STRUCTURED: Kind =
    Kind { name: "structured", focal: 566.0, size: [640, 480], noise: NoiseParams::structured_light };
/// A Kinect of the first kind.
pub const KINECT_V1: Kind =
    Kind { name: "kinect_v1", focal: 575.8, size: [640, 480], noise: NoiseParams::kinect_v1 };
/// A Kinect of the second kind.
pub const KINECT_V2: Kind =
    Kind { name: "kinect_v2", focal: 365.5, size: [512, 424], noise: NoiseParams::kinect_v2 };

impl Kind {
    /// Its intrinsics, with the principal point in the middle.
    ///
    /// # Errors
    /// Never happens for the kinds above; it is passed on.
    pub fn pinhole(&self) -> Result<Pinhole, PinholeError> {
        let [width, height] = self.size;
        let middle = |pixels: usize| (pixels as f64 - 1.0) / 2.0;
        Pinhole::new(self.focal, self.focal, middle(width), middle(height), width, height)
    }
}

/// A camera at `at` that looks to `target`, both in m in the couch's frame, turned about its axis by `turn` rad:
/// `couch_from_camera`.
#[must_use]
pub fn look(at: Vector3<f64>, target: Vector3<f64>, turn: f64) -> Isometry3<f64> {
    let z = (target - at).normalize();
    let down = (-Vector3::y() + z * z.y).normalize();
    let axes = Matrix3::from_columns(&[down.cross(&z), down, z]);
    let axes = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn);
    Isometry3::from_parts(Translation3::from(at), axes * turn)
}
