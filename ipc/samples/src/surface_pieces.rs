//! The pieces of a reference, each with its movement.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::{Codes, Layout, Sample, SampleKind, Shape};

/// The overlapping pieces of a reference in one frame: where each is, and whether it still moves with the rest.
pub struct SurfacePieces;

/// The values of the whole table.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout,
)]
#[repr(C)]
pub struct SurfacePiecesShape {
    /// Pieces of the reference; more than were sent where the port's capacity was less.
    pub found: u32,
    /// Number of rows.
    pub length: u32,
}

/// What a frame, and those before it, tell of a piece.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Codes)]
#[repr(u32)]
pub enum PieceState {
    /// Too few points of the frame lie on it.
    Unseen = 0,
    /// It was not yet seen to move with the rest, nor against it.
    Open = 1,
    /// It was seen to move with the rest.
    With = 2,
    /// It was seen not to.
    Against = 3,
}

/// One piece, about as large as a fist.
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout)]
#[repr(C)]
pub struct SurfacePiece {
    /// Its middle in the port's frame, where the frame shows the reference.
    #[unit("m")]
    pub xyz: [f32; 3],
    /// How far it has moved against the rest since the first frames, along the axes of the reference; zero before.
    #[unit("m")]
    pub moved: [f32; 3],
    /// The larger of its movements, that of the frame and the mean one, over its limit. Above 1 the frame is doubted, or
    /// the reference is not proven.
    pub over: f32,
    /// A [`PieceState`] as its number.
    #[codes(PieceState)]
    pub state: u32,
}

impl Sample for SurfacePieces {
    type Body = SurfacePiecesShape;
    type Element = SurfacePiece;
    const NAME: &'static str = "SurfacePieces";
    const SHAPE: Shape = Shape::Slice;
    const ABOUT: &'static str =
        "The pieces of a reference in one frame: where each is, and whether it still moves with the rest.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}
