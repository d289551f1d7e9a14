//! Poses.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::{Axis, Layout, Quaternion, Sample, SampleKind, Shape};

/// A rigid pose `frame_from_body` in the port's frame, with its covariance.
pub struct Pose;

/// The fields of a [`Pose`].
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout)]
#[repr(C)]
pub struct PoseElement {
    /// Translation.
    #[unit("m")]
    #[parts(Axis)]
    pub position: [f64; 3],
    /// Unit quaternion, scalar first, scalar not negative.
    #[parts(Quaternion)]
    pub orientation: [f64; 4],
    /// Covariance of (x, y, z, rotation about x, y, z), row by row; the unknown directions have infinite variance.
    #[unit("m2, rad2")]
    #[rows(6, 6)]
    pub covariance: [f64; 36],
}

impl Sample for Pose {
    type Body = ();
    type Element = PoseElement;
    const NAME: &'static str = "Pose";
    const SHAPE: Shape = Shape::Fixed;
    const ABOUT: &'static str = "Position and orientation in the port's frame, with covariance.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}
