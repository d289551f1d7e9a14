//! Convex outlines on a plane.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::{Layout, Sample, SampleKind, Shape};

/// The corners of a convex outline, counter-clockwise as seen from the side of the port's origin.
pub struct Hull;

/// The values of the whole outline.
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout)]
#[repr(C)]
pub struct HullShape {
    /// Area within the outline, all its corners counted.
    #[unit("m2")]
    pub area: f64,
    /// Corners that the outline has; more than were sent where the port's capacity was less.
    pub found: u32,
    /// Number of corners.
    pub length: u32,
}

/// One corner.
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout)]
#[repr(C)]
pub struct Corner {
    /// Coordinates in the port's frame.
    #[unit("m")]
    pub xyz: [f32; 3],
}

impl Sample for Hull {
    type Body = HullShape;
    type Element = Corner;
    const NAME: &'static str = "Hull";
    const SHAPE: Shape = Shape::Slice;
    const ABOUT: &'static str =
        "Corners of a convex outline on a plane, counter-clockwise from the origin's side.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}
