//! The journal: one entry per activation, published before the outputs of that activation.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::{Codes, Header, Layout, Sample, SampleKind, Shape};

/// An operator's journal. The header's stamp is the activation's time, its origin the activation's origin, its
/// sequence the entry's number in the incarnation.
pub struct Journal;

/// Why an activation happened, or what else the entry marks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Codes)]
#[repr(u32)]
pub enum Cause {
    /// The incarnation begins. This is no activation: the operator does not see it.
    Start = 0,
    /// A sample on the input whose number is `port`.
    Input = 1,
    /// The timer; `tick` says which.
    Timer = 2,
    /// A set of samples in step; `port` is the first input of the set.
    Sync = 3,
    /// The incarnation ended in order. Not an activation.
    End = 4,
    /// A change of a parameter on the input whose number is `port`. The operator takes it between two steps: no other input
    /// is consumed, and `index` is that of the next activation.
    Set = 5,
}

/// How an activation ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Codes)]
#[repr(u32)]
pub enum Outcome {
    /// Outputs were sent.
    Done = 0,
    /// The operator returned an error; no output was sent.
    Error = 1,
    /// The operator panicked; no output was sent.
    Panic = 2,
    /// Outputs were sent, and the operator has no more of its own: its timer stops.
    Finished = 3,
}

/// The fields of an entry that are there once.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout,
)]
#[repr(C)]
pub struct JournalBody {
    /// Number of the activation in its incarnation, from 0.
    pub index: u64,
    /// When the activation was due: the timer's tick, or the activation's time.
    #[unit("ns")]
    pub nominal: u64,
    /// Number of the timer tick; 0 without a timer.
    pub tick: u64,
    /// When the outputs of the entry before were sent; 0 where unknown. Not an input of the operator.
    #[unit("ns")]
    pub sent_before: u64,
    /// A [`Cause`] as its number.
    #[codes(Cause)]
    pub cause: u32,
    /// Input that caused it.
    pub port: u32,
    /// An [`Outcome`] as its number.
    #[codes(Outcome)]
    pub outcome: u32,
    /// Zero.
    pub reserved: [u32; 2],
    /// Number of references.
    pub length: u32,
}

/// What a reference of an entry says.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Codes)]
#[repr(u32)]
pub enum RefKind {
    /// Samples consumed for the first time.
    Fresh = 0,
    /// A `latest` sample seen before and held.
    Held = 1,
    /// Samples sent.
    Output = 2,
}

/// Samples that an activation consumed or sent on one port.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout,
)]
#[repr(C)]
pub struct JournalRef {
    /// First sequence number.
    pub first: u64,
    /// Samples taken from this edge (input) or sent (output) since the incarnation began, this entry included.
    pub total: u64,
    /// Input: samples that were sent but never taken, as their numbers show. Output: samples that found no memory.
    pub lost: u64,
    /// Input: samples taken and passed over by policy (superseded by a newer one, or without partners).
    pub passed: u64,
    /// How many samples, from `first` on.
    pub count: u32,
    /// Incarnation of the producer.
    pub incarnation: u32,
    /// Number of the port among the operator's inputs or outputs.
    pub port: u32,
    /// A [`RefKind`] as its number.
    #[codes(RefKind)]
    pub kind: u32,
}

impl Sample for Journal {
    type Body = JournalBody;
    type Element = JournalRef;
    const NAME: &'static str = "Journal";
    const SHAPE: Shape = Shape::Slice;
    const ABOUT: &'static str = "What caused an activation, what it consumed and what it sent.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}

impl Outcome {
    /// Whether the activation failed, so that no output was sent.
    pub fn is_failure(self) -> bool {
        matches!(self, Self::Error | Self::Panic)
    }
}

/// A journal entry out of its bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Time, origin, number of the entry, incarnation.
    pub header: Header,
    /// Cause and outcome.
    pub body: JournalBody,
    /// Samples consumed and sent, by port.
    pub refs: Vec<JournalRef>,
}

impl Entry {
    /// Why the activation happened; `None` for a number this build does not know.
    pub fn cause(&self) -> Option<Cause> {
        Cause::from_number(self.body.cause)
    }

    /// How it ended; `None` for a number this build does not know.
    pub fn outcome(&self) -> Option<Outcome> {
        Outcome::from_number(self.body.outcome)
    }

    /// The references of one kind.
    pub fn refs_of(&self, kind: RefKind) -> impl Iterator<Item = &JournalRef> {
        self.refs.iter().filter(move |r| r.kind == kind as u32)
    }
}
