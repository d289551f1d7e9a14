//! The space of a mean: a vector of channels, or a pose, whose rotations do not add.

use nalgebra::{Isometry3, SVector, Translation3, Unit, UnitQuaternion, Vector3};

/// A space in which a small displacement has N numbers.
pub trait Manifold<const N: usize>: Copy + PartialEq + std::fmt::Debug {
    /// The point from which absolute numbers are counted.
    fn origin() -> Self;
    /// The point displaced by `d`.
    #[must_use]
    fn plus(&self, d: &SVector<f64, N>) -> Self;
    /// The displacement that leads from `other` to this point: `other.plus(d) = self`.
    fn minus(&self, other: &Self) -> SVector<f64, N>;
}

impl<const N: usize> Manifold<N> for SVector<f64, N> {
    fn origin() -> Self {
        Self::zeros()
    }

    fn plus(&self, d: &SVector<f64, N>) -> Self {
        self + d
    }

    fn minus(&self, other: &Self) -> SVector<f64, N> {
        self - other
    }
}

/// Translation, then a rotation vector about the axes of the frame that the pose is given in:
/// t + d[0..3], exp(d[3..6]) q.
impl Manifold<6> for Isometry3<f64> {
    fn origin() -> Self {
        Self::identity()
    }

    fn plus(&self, d: &SVector<f64, 6>) -> Self {
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(d[3], d[4], d[5]));
        // Products lose the unit norm digit by digit.
        let rotation = Unit::new_normalize((turn * self.rotation).into_inner());
        Self::from_parts(
            Translation3::from(self.translation.vector + Vector3::new(d[0], d[1], d[2])),
            rotation,
        )
    }

    fn minus(&self, other: &Self) -> SVector<f64, 6> {
        let t = self.translation.vector - other.translation.vector;
        let r = (self.rotation * other.rotation.inverse()).scaled_axis();
        SVector::from([t.x, t.y, t.z, r.x, r.y, r.z])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector6;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn displacement_between_poses_leads_from_one_to_the_other(
            a in prop::array::uniform6(-1.0..1.0f64),
            d in prop::array::uniform6(-1.5..1.5f64),
        ) {
            let pose = Isometry3::origin().plus(&Vector6::from(a));
            let moved = pose.plus(&Vector6::from(d));
            prop_assert!((moved.minus(&pose) - Vector6::from(d)).norm() < 1e-12);
        }
    }

    #[test]
    fn rotation_is_about_the_axes_of_the_outer_frame() {
        let quarter = std::f64::consts::FRAC_PI_2;
        let lying = Isometry3::origin().plus(&Vector6::new(0.0, 0.0, 0.0, quarter, 0.0, 0.0));
        let turned = lying.plus(&Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, quarter));
        // The body's y axis went up to z by the first turn; a turn about the frame's z leaves it there.
        let up = turned.rotation * Vector3::y();
        assert!((up - Vector3::z()).norm() < 1e-15, "{up}");
    }
}
