//! Point clouds.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::{Layout, Sample, SampleKind, Shape};

/// A cloud of points in the port's frame; organised (`height > 1`) where the points keep the grid of their camera.
/// An invalid point has NaN in all three coordinates.
pub struct PointCloud;

/// Grid of a cloud.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout,
)]
#[repr(C)]
pub struct CloudShape {
    /// Points in a row; the number of points where `height` is 1.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Zero.
    pub reserved: u32,
    /// Number of points.
    pub length: u32,
}

/// One point.
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout)]
#[repr(C)]
pub struct Point {
    /// Coordinates in the port's frame.
    #[unit("m")]
    pub xyz: [f32; 3],
}

impl Sample for PointCloud {
    type Body = CloudShape;
    type Element = Point;
    const NAME: &'static str = "PointCloud";
    const SHAPE: Shape = Shape::Slice;
    const ABOUT: &'static str =
        "Points in the port's frame, organised as their camera's grid where height > 1.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}
