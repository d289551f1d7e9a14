//! The target of the head.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::{Angle, Axis, Channel, Codes, Layout, Sample, SampleKind, Shape};

/// The pose that a controller is to reach, in the port's frame, at the stamp of the sample.
pub struct Target;

/// What a target is at the moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Codes)]
#[repr(u32)]
pub enum TargetStatus {
    /// There is no target: the controller leaves the head where it is.
    #[word("not refused")]
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
    #[parts(Axis)]
    pub position: [f64; 3],
    /// Pitch about x, roll about y, yaw about z.
    #[unit("rad")]
    #[parts(Angle)]
    pub angles: [f64; 3],
    /// Rates of the position.
    #[unit("m/s")]
    #[parts(Axis)]
    pub velocity: [f64; 3],
    /// Rates of the angles.
    #[unit("rad/s")]
    #[parts(Angle)]
    pub angle_rates: [f64; 3],
    /// The channels that are to be held, a bit each, in the order x, y, z, pitch, roll, yaw.
    #[bits(Channel)]
    pub channels: u32,
    /// A [`TargetStatus`] as its number.
    #[codes(TargetStatus)]
    pub status: u32,
    /// Bit i is set where channel i of the target that was asked for cannot be reached.
    #[bits(Channel)]
    pub unreachable: u32,
    /// How many targets were asked for so far.
    pub asked: u32,
    /// Why the target that was asked for last was refused, as a [`Refusal`]; zero where it was not.
    #[codes(Refusal)]
    pub refusal: u32,
    /// Zero.
    pub reserved: u32,
}

/// Why a target is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Codes)]
#[repr(u32)]
pub enum Refusal {
    /// It was not.
    None = 0,
    /// It cannot be reached; `unreachable` says in which channels.
    Unreachable = 1,
    /// It has another number of values than there are channels to hold.
    WrongNumber = 2,
    /// A value is not finite.
    NotFinite = 3,
    /// The start of the head, from which targets are counted, is not known yet.
    NoStart = 4,
}

impl Refusal {
    /// The reason, as text.
    pub const fn words(self) -> &'static str {
        match self {
            Self::None => "not refused",
            Self::Unreachable => "it cannot be reached",
            Self::WrongNumber => "it needs one value for each channel that is held",
            Self::NotFinite => "a value is not finite",
            Self::NoStart => "there is no estimate yet that it could be counted from",
        }
    }
}

impl TargetElement {
    /// No target.
    pub const NONE: Self = Self {
        position: [f64::NAN; 3],
        angles: [f64::NAN; 3],
        velocity: [f64::NAN; 3],
        angle_rates: [f64::NAN; 3],
        channels: 0,
        status: TargetStatus::None as u32,
        unreachable: 0,
        asked: 0,
        refusal: Refusal::None as u32,
        reserved: 0,
    };

    /// What the target is. A number that no build of this version wrote counts as none.
    pub fn status(&self) -> TargetStatus {
        match self.status {
            1 => TargetStatus::Held,
            2 => TargetStatus::Moving,
            3 => TargetStatus::Refused,
            _ => TargetStatus::None,
        }
    }
}

impl Sample for Target {
    type Body = ();
    type Element = TargetElement;
    const NAME: &'static str = "Target";
    const SHAPE: Shape = Shape::Fixed;
    const ABOUT: &'static str = "The pose that a controller is to reach, and its rates.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}
