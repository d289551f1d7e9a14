//! How far valves are to be open.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::{Codes, Layout, Sample, SampleKind, Shape, YesNo};

/// Duties of the valves of up to eight bladders: an inlet and an outlet each.
pub struct Duties;

/// The fields of [`Duties`].
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout)]
#[repr(C)]
pub struct DutiesElement {
    /// Parts of full opening, 0 to 1: inlet and outlet of the first bladder, of the second, and so on. Zero beyond
    /// `valves`.
    pub duty: [f64; 16],
    /// The same for each bladder: duty of its inlet less duty of its outlet, -1 to 1. A model of the plant is identified
    /// from it.
    pub net: [f64; 8],
    /// How many of `duty` count: two for each bladder.
    pub valves: u32,
    /// Bit i is set where the law asked for more of valve i than there is.
    #[each("valve")]
    pub saturated: u32,
    /// 1 if the controller cannot act and asks for all valves to be shut, else 0.
    #[codes(YesNo)]
    pub idle: u32,
    /// The reasons, as the bits of [`DutyReason`]; zero if there is none.
    #[bits(DutyReason)]
    pub reasons: u32,
    /// 1 where the air is to go out into the room, with the outlets open and never into a vacuum, else 0.
    #[codes(YesNo)]
    pub vent: u32,
    /// Zero.
    pub reserved: u32,
}

/// What is out of order behind duties. The first five make a controller idle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Codes)]
#[repr(u32)]
pub enum DutyReason {
    /// No estimate came yet, or the estimator says that it has none.
    NoEstimate = 1,
    /// The newest measurement behind the estimate is too old.
    #[word("stale estimate")]
    Stale = 2,
    /// There is no target.
    NoTarget = 4,
    /// Estimate or target lacks a channel that is to be held.
    MissingChannel = 8,
    /// A number of the estimate, of the target or of the law is not finite.
    NotFinite = 16,
    /// A valve is asked for more than full opening.
    Saturated = 32,
    /// The law does not adapt.
    #[word("not adapting")]
    Frozen = 64,
    /// The target that was asked for last was refused; the one before stands.
    TargetRefused = 128,
    /// A channel is farther from the reference model than its limit.
    TrackingError = 256,
    /// The orders to a bladder go one way for long while the head rests: a valve of it is stuck, or it leaks.
    #[word("orders without effect")]
    NoEffect = 512,
}

impl DutyReason {
    /// Its bit.
    pub const fn bit(self) -> u32 {
        self as u32
    }
}

impl DutiesElement {
    /// Valves that a sample has room for.
    pub const ROOM: usize = 16;

    /// All valves of this many shut, for these reasons.
    pub fn shut(valves: u32, reasons: u32) -> Self {
        Self { valves, idle: 1, reasons, ..Self::default() }
    }

    /// All air of this many valves let out into the room: inlets shut, outlets open.
    pub fn vented(valves: u32) -> Self {
        let mut vented = Self { valves, vent: 1, ..Self::default() };
        let count = (valves as usize).min(Self::ROOM);
        vented.duty[..count].iter_mut().skip(1).step_by(2).for_each(|outlet| *outlet = 1.0);
        vented.net[..count / 2].fill(-1.0);
        vented
    }

    /// The reasons, as text.
    pub fn reasons(&self) -> impl Iterator<Item = &'static str> {
        let bits = self.reasons;
        DutyReason::ALL.iter().filter(move |(_, reason)| bits & reason.bit() != 0).map(|(word, _)| *word)
    }
}

impl Sample for Duties {
    type Body = ();
    type Element = DutiesElement;
    const NAME: &'static str = "Duties";
    const SHAPE: Shape = Shape::Fixed;
    const ABOUT: &'static str = "How far valves are to be open: an inlet and an outlet for each bladder.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}
