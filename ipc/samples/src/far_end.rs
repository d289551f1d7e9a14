//! What the far end of valves and beam does, and why.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::{Codes, Layout, OnOff, Sample, SampleKind, Shape};

/// The state of the far end of valves and beam, and its counts of datagrams.
pub struct FarEnd;

/// What the far end has the valves do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Codes)]
#[repr(u32)]
pub enum FarEndDoing {
    /// All valves are shut.
    Holding = 0,
    /// Inlets are shut, outlets open.
    Venting = 1,
    /// The valves follow duties.
    Following = 2,
}

/// The fields of a [`FarEnd`].
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout,
)]
#[repr(C)]
pub struct FarEndElement {
    /// When the last accepted datagram for the valves arrived, ns of session time; 0 before the first.
    #[unit("ns")]
    pub arrived: u64,
    /// When its life is over, ns of session time; 0 before the first.
    #[unit("ns")]
    pub ends: u64,
    /// Since when `doing` is what it is, ns of session time.
    #[unit("ns")]
    pub since: u64,
    /// Datagrams for the valves that were accepted.
    pub accepted: u64,
    /// Refused datagrams for the valves, or without a known recipient.
    pub refused: u64,
    /// Datagrams for the beam that were refused.
    pub refused_beam: u64,
    /// Numbers that were passed over: datagrams lost on the way, or refused.
    pub missing: u64,
    /// A [`FarEndDoing`] as its number.
    #[codes(FarEndDoing)]
    pub doing: u32,
    /// 1 where the beam may be on, else 0.
    #[codes(OnOff)]
    pub beam: u32,
}

impl FarEndElement {
    /// What the valves do. A number that no build of this version wrote counts as venting.
    pub fn doing(&self) -> FarEndDoing {
        match self.doing {
            0 => FarEndDoing::Holding,
            2 => FarEndDoing::Following,
            _ => FarEndDoing::Venting,
        }
    }
}

impl Sample for FarEnd {
    type Body = ();
    type Element = FarEndElement;
    const NAME: &'static str = "FarEnd";
    const SHAPE: Shape = Shape::Fixed;
    const ABOUT: &'static str = "What the far end of valves and beam does, and what became of the datagrams.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}
