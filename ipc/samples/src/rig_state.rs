//! What the bladders, valves and faults of a rig are at.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::{Codes, Layout, Sample, SampleKind, Shape};

/// Pressures, air, valves and faults of a rig of up to eight bladders.
pub struct RigState;

/// What moves a rig's valves at the moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Codes)]
#[repr(u32)]
pub enum RigMode {
    /// No duties came yet: the valves are shut.
    Waiting = 0,
    /// The valves follow the duties that arrive.
    Driven = 1,
    /// Duties stopped: the valves are shut.
    Holding = 2,
    /// Duties stopped, or ask for it: the air is let out into the room.
    Venting = 3,
}

/// The fields of a [`RigState`]. What a rig does not have is zero.
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout)]
#[repr(C)]
pub struct RigStateElement {
    /// Pressure in each bladder over that of the room.
    #[unit("Pa")]
    pub pressure: [f64; 8],
    /// Air in each bladder.
    #[unit("kg")]
    pub air_mass: [f64; 8],
    /// Distance of each bladder's plates.
    #[unit("m")]
    pub gap: [f64; 8],
    /// Force of each bladder on the head.
    #[unit("N")]
    pub force: [f64; 8],
    /// Opening of inlet and outlet of the first bladder, of the second, and so on, 0 to 1.
    pub opening: [f64; 16],
    /// How old the duties are; NaN where there are none.
    #[unit("s")]
    pub duties_age: f64,
    /// Duties that were refused so far: not finite, out of range, or for another number of valves.
    pub refused: u64,
    /// How many bladders there are.
    pub bladders: u32,
    /// A [`RigMode`] as its number.
    #[codes(RigMode)]
    pub mode: u32,
    /// The faults that act at the moment, as bits: 1 a stuck valve, 2 a leak, 4 a weak supply, 8 a blind camera, 16 a
    /// silent camera, 32 lost duties, 64 a frozen camera.
    #[bits(RigFault)]
    pub faults: u32,
    /// Bit i is set if bladder i is pressed or emptied beyond the range of its model.
    #[each("bladder")]
    pub unmodelled: u32,
}

/// A fault of a rig, as its bit in [`RigStateElement::faults`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Codes)]
#[repr(u32)]
pub enum RigFault {
    /// A valve keeps the opening that it has.
    #[word("stuck_valve")]
    StuckValve = 1,
    /// A bladder has a hole to the room.
    Leak = 2,
    /// The supply's pressure falls.
    #[word("weak_supply")]
    WeakSupply = 4,
    /// The camera's images are empty.
    #[word("blind_camera")]
    BlindCamera = 8,
    /// The camera sends no images.
    #[word("silent_camera")]
    SilentCamera = 16,
    /// Duties get lost on their way.
    #[word("lost_duties")]
    LostDuties = 32,
    /// The camera sends the same image again and again.
    #[word("frozen_camera")]
    FrozenCamera = 64,
}

impl RigStateElement {
    /// What moves the valves. A number that no build of this version wrote counts as waiting.
    pub fn mode(&self) -> RigMode {
        match self.mode {
            1 => RigMode::Driven,
            2 => RigMode::Holding,
            3 => RigMode::Venting,
            _ => RigMode::Waiting,
        }
    }
}

impl Sample for RigState {
    type Body = ();
    type Element = RigStateElement;
    const NAME: &'static str = "RigState";
    const SHAPE: Shape = Shape::Fixed;
    const ABOUT: &'static str = "Pressures, air, valve openings and faults of a rig.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}
