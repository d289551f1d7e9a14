//! Ellipsoids and cuboids, the shapes that everything in the scene is made of.

use nalgebra::{Isometry3, Vector3};

/// Why a shape cannot be built.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ShapeError {
    /// A half size that is not a length.
    #[error("half size {axis} of the {shape} is {value} m; give a length from 1e-4 m to 100 m")]
    HalfSize {
        /// Which kind of shape.
        shape: &'static str,
        /// Which axis of the shape.
        axis: char,
        /// The value given, in metres.
        value: f64,
    },
    /// A pose with a number that is not finite.
    #[error("the {shape} is placed at {value}, which is not finite; give finite translation and rotation")]
    Pose {
        /// Which kind of shape.
        shape: &'static str,
        /// The first component that is not finite.
        value: f64,
    },
}

/// An ellipsoid with its centre at the origin of its own frame and semi-axes along x, y and z.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ellipsoid {
    parent_from_shape: Isometry3<f64>,
    semi_axes: Vector3<f64>,
}

/// A cuboid with its centre at the origin of its own frame and faces across x, y and z.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cuboid {
    parent_from_shape: Isometry3<f64>,
    half_sizes: Vector3<f64>,
}

impl Ellipsoid {
    /// Places an ellipsoid; semi-axes in metres.
    ///
    /// # Errors
    /// [`ShapeError`] when a semi-axis is not a length from 0.1 mm to 100 m or the pose is not finite.
    pub fn new(parent_from_shape: Isometry3<f64>, semi_axes: Vector3<f64>) -> Result<Self, ShapeError> {
        check("ellipsoid", &parent_from_shape, &semi_axes)?;
        Ok(Self { parent_from_shape, semi_axes })
    }

    /// The same ellipsoid at another place. A pose that is not finite is the caller's to refuse.
    #[must_use]
    pub fn placed(&self, parent_from_shape: Isometry3<f64>) -> Self {
        Self { parent_from_shape, ..*self }
    }

    /// The pose of the ellipsoid in the frame of whatever it belongs to.
    pub fn parent_from_shape(&self) -> &Isometry3<f64> {
        &self.parent_from_shape
    }

    /// The semi-axes along the ellipsoid's own x, y and z, in metres.
    pub fn semi_axes(&self) -> &Vector3<f64> {
        &self.semi_axes
    }
}

impl Cuboid {
    /// Places a cuboid; half sizes in metres.
    ///
    /// # Errors
    /// [`ShapeError`] when a half size is not a length from 0.1 mm to 100 m or the pose is not finite.
    pub fn new(parent_from_shape: Isometry3<f64>, half_sizes: Vector3<f64>) -> Result<Self, ShapeError> {
        check("cuboid", &parent_from_shape, &half_sizes)?;
        Ok(Self { parent_from_shape, half_sizes })
    }

    /// The pose of the cuboid in the frame of whatever it belongs to.
    pub fn parent_from_shape(&self) -> &Isometry3<f64> {
        &self.parent_from_shape
    }

    /// Half the sizes along the cuboid's own x, y and z, in metres.
    pub fn half_sizes(&self) -> &Vector3<f64> {
        &self.half_sizes
    }
}

fn check(
    shape: &'static str,
    parent_from_shape: &Isometry3<f64>,
    half_sizes: &Vector3<f64>,
) -> Result<(), ShapeError> {
    for (axis, &value) in ['x', 'y', 'z'].into_iter().zip(half_sizes.iter()) {
        if !(1e-4..=100.0).contains(&value) {
            return Err(ShapeError::HalfSize { shape, axis, value });
        }
    }
    match first_non_finite(parent_from_shape) {
        Some(value) => Err(ShapeError::Pose { shape, value }),
        None => Ok(()),
    }
}

/// The first component of a pose that is not finite, if any.
pub(crate) fn first_non_finite(pose: &Isometry3<f64>) -> Option<f64> {
    let translation = pose.translation.vector.iter();
    translation.chain(pose.rotation.coords.iter()).copied().find(|value| !value.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_half_size_that_is_no_length_is_refused_by_name(
            bad in prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(0.0), -1e3..0.0f64, 101.0..1e9],
            axis in 0usize..3,
        ) {
            let mut sizes = Vector3::new(0.1, 0.2, 0.3);
            sizes[axis] = bad;
            let name = ['x', 'y', 'z'][axis];
            let message = Ellipsoid::new(Isometry3::identity(), sizes).unwrap_err().to_string();
            prop_assert!(message.contains(&format!("half size {name}")), "{}", message);
            prop_assert!(message.contains(&bad.to_string()), "{}", message);
            prop_assert!(Cuboid::new(Isometry3::identity(), sizes).is_err());
        }
    }

    #[test]
    fn a_pose_that_is_not_finite_is_refused() {
        let pose = Isometry3::translation(0.0, f64::NAN, 0.0);
        let error = Cuboid::new(pose, Vector3::repeat(0.1)).unwrap_err();
        assert!(matches!(error, ShapeError::Pose { shape: "cuboid", value } if value.is_nan()));
    }
}
