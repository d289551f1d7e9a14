//! Grey images.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::{Layout, Sample, SampleKind, Shape};

/// A grey image, row by row from the top left; 0 is black.
pub struct GreyImage;

/// Size of a grey image.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout,
)]
#[repr(C)]
pub struct GreyShape {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Zero.
    pub reserved: u32,
    /// Number of pixels.
    pub length: u32,
}

impl Sample for GreyImage {
    type Body = GreyShape;
    type Element = u8;
    const NAME: &'static str = "GreyImage";
    const SHAPE: Shape = Shape::Slice;
    const ABOUT: &'static str = "Brightness of each pixel, row by row from the top left; 0 is black.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}
