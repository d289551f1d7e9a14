//! Commands that people send into a running pipeline.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::{Codes, Layout, Sample, SampleKind, Shape};

/// A person's command. People change a running pipeline only by samples, so this topic is the audit trail.
pub struct ConsoleCommand;

/// What is commanded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Codes)]
#[repr(u32)]
pub enum Verb {
    /// Allow actuation.
    Arm = 1,
    /// Forbid actuation.
    Disarm = 2,
    /// Take a reference of what the camera sees now.
    Capture = 3,
    /// Move to the target in `values`.
    Target = 4,
    /// Go on after a fault.
    Resume = 5,
    /// Let all pressure out.
    Vent = 6,
    /// Begin a fault on a simulated rig: the number of a [`RigFault`](crate::RigFault), the part, the amount, and the
    /// duration in seconds; 0 removes all such faults.
    Fault = 7,
    /// Confirm that the reference shows the head.
    Confirm = 8,
    /// Accept the offered plan of the request whose number is the first of `values`.
    Accept = 9,
}

impl Verb {
    /// The verb of this word.
    pub fn from_word(word: &str) -> Option<Self> {
        Self::ALL.iter().find(|(w, _)| *w == word).map(|(_, v)| *v)
    }
}

/// The fields of a [`ConsoleCommand`].
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout)]
#[repr(C)]
pub struct Command {
    /// Arguments of the verb, SI units; zero where there are none.
    pub values: [f64; 6],
    /// A [`Verb`] as its number.
    #[codes(Verb)]
    pub verb: u32,
    /// How many of `values` are given.
    pub given: u32,
    /// Who sent it, in ASCII, filled with zeros.
    pub by: [u8; 32],
}

impl Sample for ConsoleCommand {
    type Body = ();
    type Element = Command;
    const NAME: &'static str = "ConsoleCommand";
    const SHAPE: Shape = Shape::Fixed;
    const ABOUT: &'static str = "A person's command to a running pipeline.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}
