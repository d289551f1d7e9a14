//! Planes that points were found to lie on.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::{Axis, Layout, Sample, SampleKind, Shape, YesNo};

/// The points p of the port's frame with `normal · p + offset = 0`, and how well a cloud's points agree.
pub struct Plane;

/// The fields of a [`Plane`].
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout)]
#[repr(C)]
pub struct PlaneElement {
    /// Unit normal, toward the side of the frame's origin.
    #[parts(Axis)]
    pub normal: [f64; 3],
    /// Distance of the frame's origin from the plane, not negative.
    #[unit("m")]
    pub offset: f64,
    /// Root mean square of the inliers' distances.
    #[unit("m")]
    pub rms: f64,
    /// Points within the tolerance.
    pub inliers: u32,
    /// Points that were tested.
    pub points: u32,
    /// 1 if the plane of the frame before was confirmed on this frame and kept, 0 if it was searched again.
    #[codes(YesNo)]
    pub kept: u32,
    /// Hypotheses that were weighed.
    pub hypotheses: u32,
}

impl Sample for Plane {
    type Body = ();
    type Element = PlaneElement;
    const NAME: &'static str = "Plane";
    const SHAPE: Shape = Shape::Fixed;
    const ABOUT: &'static str = "A plane in the port's frame, and how well points agree with it.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}
