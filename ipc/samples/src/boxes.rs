//! Faces found in an image.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::{Layout, Sample, SampleKind, Shape};

/// Where an image shows faces, the most certain first; none where it shows none.
pub struct FaceBoxes;

/// The values that all boxes share.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout,
)]
#[repr(C)]
pub struct FaceBoxesShape {
    /// Pixels in a row of the image.
    #[unit("px")]
    pub width: u32,
    /// Rows of the image.
    #[unit("px")]
    pub height: u32,
    /// Direction of the top of the head in the image: 0 up, 1 right, 2 down, 3 left.
    pub top: u32,
    /// Number of boxes.
    pub length: u32,
}

/// One face.
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout)]
#[repr(C)]
pub struct FaceBox {
    /// How certain the detector is, in its own unit; larger is more certain.
    pub score: f64,
    /// Column of the box's left edge; it may lie outside of the image.
    #[unit("px")]
    pub left: i32,
    /// Row of its top edge.
    #[unit("px")]
    pub top: i32,
    /// Columns.
    #[unit("px")]
    pub width: u32,
    /// Rows.
    #[unit("px")]
    pub height: u32,
}

impl Sample for FaceBoxes {
    type Body = FaceBoxesShape;
    type Element = FaceBox;
    const NAME: &'static str = "FaceBoxes";
    const SHAPE: Shape = Shape::Slice;
    const ABOUT: &'static str = "Where an image shows faces, the most certain first.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}
