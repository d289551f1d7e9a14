//! The messages between those who ask and workers.

use serde::{Deserialize, Serialize, Serializer};
use stillpoint_samples::PoolWord;

use crate::wire::{self, Format, WireError, at_most};
use crate::{Hash, build, call};

/// Bytes of a part of a content.
pub const PART: usize = 128 << 10;
/// The longest answer that is sent as one message, bytes. A longer one is fetched in parts.
pub const INLINE: usize = 64 << 10;
/// The longest content that is fetched, bytes.
pub const LONGEST_CONTENT: u64 = 4 << 30;
const LONGEST_REASON: usize = 4096;
/// The longest name of a worker, bytes.
const LONGEST_NAME: usize = 64;
/// The most contents of a message.
pub const MOST_HELD: usize = 1024;

/// The most of the slots of a worker, of its calls, and of the calls that one client asks.
pub const MOST_CALLS: u32 = 65_536;

/// A message with a call is the longest one.
const FORMAT: Format = Format { what: "a message", mark: b"SPM3", most: call::MOST_BYTES + 1024 };

/// A message.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Message {
    /// A worker is there.
    Hello(Hello),
    /// A call.
    Ask {
        /// Its key.
        key: Hash,
        /// Its bytes.
        #[serde(with = "wire::bytes")]
        call: Vec<u8>,
    },
    /// The worker has the call and has no answer yet.
    Working {
        /// Its key.
        key: Hash,
    },
    /// The worker has no room for the call.
    Busy {
        /// Its key.
        key: Hash,
    },
    /// A short answer.
    Answer {
        /// Key of the call.
        key: Hash,
        /// The answer; its CRC-32 is on the wire.
        #[serde(with = "wire::bytes::checked")]
        bytes: Vec<u8>,
    },
    /// A long answer can be fetched.
    Done {
        /// Key of the call.
        key: Hash,
        /// Name of the answer.
        answer: Hash,
    },
    /// The worker cannot answer.
    Failed {
        /// Key of the call.
        key: Hash,
        /// Why.
        #[serde(serialize_with = "beginning")]
        reason: String,
    },
    /// The answer is no longer wanted.
    Cancel {
        /// Key of the call.
        key: Hash,
    },
    /// A part of a content is wanted.
    Want {
        /// The content.
        content: Hash,
        /// Number of the part.
        part: u32,
        /// Nobody else is to give it: another worker did not.
        only: bool,
    },
    /// A part of a content.
    Part {
        /// The content.
        content: Hash,
        /// Number of the part.
        part: u32,
        /// Length of the whole content.
        length: u64,
        /// The bytes; their CRC-32 is on the wire.
        #[serde(with = "wire::bytes::checked")]
        bytes: Vec<u8>,
    },
    /// The content is not here.
    Absent {
        /// The content.
        content: Hash,
    },
    /// The content can be fetched from another worker.
    Elsewhere {
        /// The content.
        content: Hash,
        /// Name of the worker.
        peer: String,
    },
    /// These contents are here: others may fetch them.
    Holds {
        /// The contents.
        contents: Vec<Hash>,
    },
    /// Another worker gave something else as this content.
    Wrong {
        /// The content.
        content: Hash,
        /// Name of the worker.
        peer: String,
    },
    /// So many calls of one who asks have no answer yet.
    Demand {
        /// Their number.
        calls: u32,
    },
    /// The times of a call that is answered now, and the length of the answer.
    Spent {
        /// Key of the call.
        key: Hash,
        /// The times.
        spent: Spent,
    },
}

/// On what a worker spent its time for a call, ns, and how long the answer is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Spent {
    /// Taking messages since the answer before.
    pub received: u64,
    /// Opening arguments.
    pub opened: u64,
    /// Computing.
    pub computed: u64,
    /// Bytes of the answer: all its parts can be asked for at once.
    pub length: u64,
}

/// What a worker tells of itself, several times a second.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hello {
    /// Its build.
    pub build: String,
    /// Number of its life: a later one is higher.
    pub incarnation: u64,
    /// Calls that it computes at the same time.
    pub slots: u32,
    /// Calls that it computes now.
    pub running: u32,
    /// Calls that wait for arguments or a slot.
    pub waiting: u32,
    /// Calls answered in this life.
    pub answered: u64,
    /// Answers among these that were in the cache.
    pub known: u64,
    /// Bytes of the cache.
    pub cache: u64,
    /// The most bytes of the cache.
    pub cache_most: u64,
}

impl Message {
    /// The bytes.
    pub fn to_bytes(&self) -> Vec<u8> {
        FORMAT.write(self)
    }

    /// What it says, and the call or content that it is about.
    pub fn summary(&self) -> (PoolWord, Option<Hash>) {
        match self {
            Self::Hello(_) => (PoolWord::Hello, None),
            Self::Ask { key, .. } => (PoolWord::Ask, Some(*key)),
            Self::Working { key } => (PoolWord::Working, Some(*key)),
            Self::Busy { key } => (PoolWord::Busy, Some(*key)),
            Self::Answer { key, .. } => (PoolWord::Answer, Some(*key)),
            Self::Done { key, .. } => (PoolWord::Done, Some(*key)),
            Self::Failed { key, .. } => (PoolWord::Failed, Some(*key)),
            Self::Cancel { key } => (PoolWord::Cancel, Some(*key)),
            Self::Want { content, .. } => (PoolWord::Want, Some(*content)),
            Self::Part { content, .. } => (PoolWord::Part, Some(*content)),
            Self::Absent { content } => (PoolWord::Absent, Some(*content)),
            Self::Elsewhere { content, .. } => (PoolWord::Elsewhere, Some(*content)),
            Self::Holds { contents } => (PoolWord::Holds, contents.first().copied()),
            Self::Wrong { content, .. } => (PoolWord::Wrong, Some(*content)),
            Self::Demand { .. } => (PoolWord::Demand, None),
            Self::Spent { key, .. } => (PoolWord::Spent, Some(*key)),
        }
    }

    /// Reads a message from bytes that anybody may have sent.
    ///
    /// # Errors
    /// The bytes are no message.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, WireError> {
        let message: Self = FORMAT.read(bytes)?;
        match &message {
            Self::Hello(Hello { build, slots, running, waiting, .. }) => {
                at_most(build.len(), build::LONGEST, "the length of a build")?;
                let most = *slots.max(running).max(waiting);
                at_most(most as usize, MOST_CALLS as usize, "the number of calls of a worker")?;
            }
            Self::Ask { call, .. } => at_most(call.len(), call::MOST_BYTES, "the length of a call")?,
            Self::Answer { bytes, .. } => at_most(bytes.len(), INLINE, "the length of an answer")?,
            Self::Failed { reason, .. } => at_most(reason.len(), LONGEST_REASON, "the length of a reason")?,
            Self::Part { bytes, .. } => at_most(bytes.len(), PART, "the length of a part")?,
            Self::Elsewhere { peer, .. } | Self::Wrong { peer, .. } => {
                at_most(peer.len(), LONGEST_NAME, "the length of a name")?;
            }
            Self::Holds { contents } => at_most(contents.len(), MOST_HELD, "the number of contents")?,
            Self::Demand { calls } => at_most(*calls as usize, MOST_CALLS as usize, "the number of calls")?,
            Self::Working { .. }
            | Self::Busy { .. }
            | Self::Done { .. }
            | Self::Cancel { .. }
            | Self::Want { .. }
            | Self::Absent { .. }
            | Self::Spent { .. } => {}
        }
        Ok(message)
    }
}

/// The beginning of a reason, as much as a reader takes.
fn beginning<S: Serializer>(reason: &str, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_str(&reason[..reason.floor_char_boundary(LONGEST_REASON)])
}
