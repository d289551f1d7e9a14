//! Where the head is to be.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::{Layout, Sample, SampleKind, Shape};

/// The pose that a controller is to reach, in the port's frame, at the stamp of the sample.
pub struct Target;

/// What a target is at the moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum TargetStatus {
    /// There is no target: the head is to be left where it is.
    None = 0,
    /// The target stands.
    Held = 1,
    /// The target moves.
    Moving = 2,
    /// A new target was asked for and refused; the one before stands.
    Refused = 3,
}

/// The fields of a [`Target`]. A channel that is not controlled is NaN.
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout)]
#[repr(C)]
pub struct TargetElement {
    /// Position x, y, z.
    #[unit("m")]
    pub position: [f64; 3],
    /// Pitch about x, roll about y, yaw about z.
    #[unit("rad")]
    pub angles: [f64; 3],
    /// Rates of the position.
    #[unit("m/s")]
    pub velocity: [f64; 3],
    /// Rates of the angles.
    #[unit("rad/s")]
    pub angle_rates: [f64; 3],
    /// The channels that are to be held, a bit each, in the order x, y, z, pitch, roll, yaw.
    pub channels: u32,
    /// A [`TargetStatus`] as its number.
    pub status: u32,
    /// Bit i is set where channel i of the target that was asked for cannot be reached.
    pub unreachable: u32,
    /// How many targets were asked for so far.
    pub asked: u32,
}

impl Sample for Target {
    type Body = ();
    type Element = TargetElement;
    const NAME: &'static str = "Target";
    const SHAPE: Shape = Shape::Fixed;
    const ABOUT: &'static str = "The pose that a controller is to reach, and its rates.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}
