//! How far valves are to be open.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::{Layout, Sample, SampleKind, Shape};

/// Duties of the valves of up to eight bladders: an inlet and an outlet each.
pub struct Duties;

/// The fields of [`Duties`].
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout)]
#[repr(C)]
pub struct DutiesElement {
    /// Parts of full opening, 0 to 1: inlet and outlet of the first bladder, of the second, and so on. Zero beyond
    /// `valves`.
    pub duty: [f64; 16],
    /// How many of `duty` count: two for each bladder.
    pub valves: u32,
    /// Bit i is set where the law asked for more of valve i than there is.
    pub saturated: u32,
    /// 1 where the controller has nothing to act on and asks that all valves be shut, else 0.
    pub idle: u32,
    /// Why, as bits that the controller's reference names; zero where nothing is out of order.
    pub reasons: u32,
}

impl DutiesElement {
    /// Valves that a sample has room for.
    pub const ROOM: usize = 16;
}

impl Sample for Duties {
    type Body = ();
    type Element = DutiesElement;
    const NAME: &'static str = "Duties";
    const SHAPE: Shape = Shape::Fixed;
    const ABOUT: &'static str = "How far valves are to be open: an inlet and an outlet for each bladder.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}
