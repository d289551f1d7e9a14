//! Depth images.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::{Layout, Sample, SampleKind, Shape};

/// A depth image, row by row from the top left; 0 means no reading. Depth is along the optical axis (z).
pub struct DepthImage;

/// Pinhole intrinsics of a depth image. Camera axes: x right, y down, z forward.
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout)]
#[repr(C)]
pub struct Intrinsics {
    /// Focal length along x.
    #[unit("px")]
    pub fx: f64,
    /// Focal length along y.
    #[unit("px")]
    pub fy: f64,
    /// Principal point, x.
    #[unit("px")]
    pub cx: f64,
    /// Principal point, y.
    #[unit("px")]
    pub cy: f64,
    /// Depth of one count.
    #[unit("m")]
    pub depth_unit: f64,
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Zero.
    pub reserved: u32,
    /// Number of pixels.
    pub length: u32,
}

impl Sample for DepthImage {
    type Body = Intrinsics;
    type Element = u16;
    const NAME: &'static str = "DepthImage";
    const SHAPE: Shape = Shape::Slice;
    const ABOUT: &'static str = "Depth along the optical axis in counts of depth_unit; 0 is not a reading.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}
