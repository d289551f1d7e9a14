//! How the bladders hold the head.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::{Layout, Sample, SampleKind, Shape};

/// Force of each bladder on the head, and how far its contact is from sliding.
pub struct Contacts;

/// The fields of a [`Contacts`]. What a rig does not have is zero.
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout)]
#[repr(C)]
pub struct ContactsElement {
    /// Force of each bladder on the head, along its normal.
    #[unit("N")]
    pub force: [f64; 8],
    /// Force along each contact that friction has to bear; NaN where the places of the contacts are not known.
    #[unit("N")]
    pub tangential: [f64; 8],
    /// Margin of the friction cone: what friction could bear, less what it has to; NaN as `tangential`.
    #[unit("N")]
    pub margin: [f64; 8],
    /// Distance of each bladder's plates.
    #[unit("m")]
    pub gap: [f64; 8],
    /// How many bladders there are; 0 while pose or pressures are not known.
    pub bladders: u32,
    /// Bit i is set where bladder i pushes with less than the least force.
    #[each("bladder")]
    pub low: u32,
    /// Bit i is set where contact i slides.
    #[each("contact")]
    pub slides: u32,
    /// Zero.
    pub reserved: u32,
}

impl Sample for Contacts {
    type Body = ();
    type Element = ContactsElement;
    const NAME: &'static str = "Contacts";
    const SHAPE: Shape = Shape::Fixed;
    const ABOUT: &'static str = "Force of each bladder on the head, and the margin of its friction cone.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}
