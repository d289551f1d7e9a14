//! Messages between an operator and the workers of a planning pool.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::{Codes, Layout, Sample, SampleKind, Shape};

/// The most bytes of a message of a worker.
pub const LONGEST_POOL_MESSAGE: usize = (128 << 10) + 1024;

/// A message to workers of a planning pool, or from one. The elements are the length of the worker's name (one byte; 0:
/// to all), the name, and the message as it is on the network.
pub struct PoolMessage;

/// What the message says, for those who read a session; the elements say the same.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout,
)]
#[repr(C)]
pub struct PoolMessageBody {
    /// SHA-256 of the call or of the content that the message is about, as four little-endian words; 0 where it is about
    /// none.
    pub key: [u64; 4],
    /// A [`PoolWord`] as its number.
    #[codes(PoolWord)]
    pub word: u32,
    /// Number of bytes.
    pub length: u32,
}

/// What a message of the pool says.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Codes)]
#[repr(u32)]
pub enum PoolWord {
    /// A worker is there.
    Hello = 0,
    /// A call.
    Ask = 1,
    /// The worker has the call and has no answer yet.
    Working = 2,
    /// The worker has no room for the call.
    Busy = 3,
    /// A short answer.
    Answer = 4,
    /// A long answer can be fetched.
    Done = 5,
    /// The worker cannot answer.
    Failed = 6,
    /// The answer is no longer wanted.
    Cancel = 7,
    /// A part of a content is wanted.
    Want = 8,
    /// A part of a content.
    Part = 9,
    /// The content is not here.
    Absent = 10,
    /// The content can be fetched from another worker.
    Elsewhere = 11,
    /// Contents are here: others may fetch them.
    Holds = 12,
    /// Another worker gave something else as this content.
    Wrong = 13,
    /// So many calls have no answer yet.
    Demand = 14,
    /// The times of a call that is answered now.
    Spent = 15,
    /// This run has no network: nobody will answer. The sample has no elements.
    NoNetwork = 255,
}

impl Sample for PoolMessage {
    type Body = PoolMessageBody;
    type Element = u8;
    const NAME: &'static str = "PoolMessage";
    const SHAPE: Shape = Shape::Slice;
    const ABOUT: &'static str = "A message to workers of a planning pool, or from one.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}
