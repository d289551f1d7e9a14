//! The messages between those who ask and workers.

use stillpoint_samples::PoolWord;

use crate::wire::{Reader, WireError, Writer};
use crate::{Hash, build, call};

const MAGIC: &[u8; 4] = b"SPM2";
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

/// A message.
#[derive(Clone, Debug, PartialEq)]
pub enum Message {
    /// A worker is there.
    Hello(Hello),
    /// A call.
    Ask {
        /// Its key.
        key: Hash,
        /// Its bytes.
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
        /// The answer.
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
}

/// What a worker tells of itself, several times a second.
#[derive(Clone, Debug, PartialEq)]
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
        let mut out = Writer(MAGIC.to_vec());
        match self {
            Self::Hello(hello) => {
                out.byte(0);
                out.bytes(hello.build.as_bytes());
                out.number(hello.incarnation);
                let counts = [hello.slots, hello.running, hello.waiting].map(u64::from);
                counts.into_iter().for_each(|count| out.number(count));
                let more = [hello.answered, hello.known, hello.cache, hello.cache_most];
                more.into_iter().for_each(|count| out.number(count));
            }
            Self::Ask { key, call } => keyed(&mut out, 1, key).bytes(call),
            Self::Working { key } => drop(keyed(&mut out, 2, key)),
            Self::Busy { key } => drop(keyed(&mut out, 3, key)),
            Self::Answer { key, bytes } => {
                let out = keyed(&mut out, 4, key);
                out.number(u64::from(crc32fast::hash(bytes)));
                out.bytes(bytes);
            }
            Self::Done { key, answer } => keyed(&mut out, 5, key).hash(answer),
            Self::Failed { key, reason } => {
                let end = reason.floor_char_boundary(LONGEST_REASON);
                keyed(&mut out, 6, key).bytes(&reason.as_bytes()[..end]);
            }
            Self::Cancel { key } => drop(keyed(&mut out, 7, key)),
            Self::Want { content, part, only } => {
                let out = keyed(&mut out, 8, content);
                out.number(u64::from(*part));
                out.byte(u8::from(*only));
            }
            Self::Part { content, part, length, bytes } => {
                let out = keyed(&mut out, 9, content);
                out.number(u64::from(*part));
                out.number(*length);
                out.number(u64::from(crc32fast::hash(bytes)));
                out.bytes(bytes);
            }
            Self::Absent { content } => drop(keyed(&mut out, 10, content)),
            Self::Elsewhere { content, peer } => keyed(&mut out, 11, content).bytes(peer.as_bytes()),
            Self::Holds { contents } => {
                out.byte(12);
                out.number(contents.len() as u64);
                contents.iter().for_each(|content| out.hash(content));
            }
            Self::Wrong { content, peer } => keyed(&mut out, 13, content).bytes(peer.as_bytes()),
        }
        out.0
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
        }
    }

    /// Reads a message from bytes that anybody may have sent.
    ///
    /// # Errors
    /// The bytes are no message.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, WireError> {
        let mut from = Reader::new(bytes);
        if from.raw(4, "a message")? != MAGIC {
            return Err(WireError::Unknown("the version of a message"));
        }
        let kind = from.byte("the kind of a message")?;
        if kind == 0 {
            let hello = hello(&mut from)?;
            from.end()?;
            return Ok(Self::Hello(hello));
        }
        if kind == 12 {
            let contents = from.list(MOST_HELD, "the number of contents", |from| from.hash("a content"))?;
            from.end()?;
            return Ok(Self::Holds { contents });
        }
        let key = from.hash("a key")?;
        let message = match kind {
            1 => Self::Ask { key, call: from.bytes(call::MOST_BYTES, "a call")?.to_vec() },
            2 => Self::Working { key },
            3 => Self::Busy { key },
            4 => Self::Answer { key, bytes: checked(&mut from, INLINE)? },
            5 => Self::Done { key, answer: from.hash("an answer")? },
            6 => Self::Failed { key, reason: from.text(LONGEST_REASON, "a reason")? },
            7 => Self::Cancel { key },
            8 => Self::Want {
                content: key,
                part: from.count(u32::MAX as usize, "a part")? as u32,
                only: from.flag("whether nobody else is to give it")?,
            },
            9 => Self::Part {
                content: key,
                part: from.count(u32::MAX as usize, "a part")? as u32,
                length: from.number("a length")?,
                bytes: checked(&mut from, PART)?,
            },
            10 => Self::Absent { content: key },
            11 => Self::Elsewhere { content: key, peer: from.text(LONGEST_NAME, "a name")? },
            13 => Self::Wrong { content: key, peer: from.text(LONGEST_NAME, "a name")? },
            _ => return Err(WireError::Unknown("the kind of a message")),
        };
        from.end()?;
        Ok(message)
    }
}

fn keyed<'w>(out: &'w mut Writer, kind: u8, key: &Hash) -> &'w mut Writer {
    out.byte(kind);
    out.hash(key);
    out
}

/// Bytes behind their checksum.
fn checked(from: &mut Reader<'_>, most: usize) -> Result<Vec<u8>, WireError> {
    let checksum = from.number("a checksum")?;
    let bytes = from.bytes(most, "a content")?;
    match u64::from(crc32fast::hash(bytes)) == checksum {
        true => Ok(bytes.to_vec()),
        false => Err(WireError::Unknown("a content that does not have its checksum")),
    }
}

fn hello(from: &mut Reader<'_>) -> Result<Hello, WireError> {
    let build = from.text(build::LONGEST, "a build")?;
    let incarnation = from.number("an incarnation")?;
    let mut count = |what| Ok::<_, WireError>(from.count(65_536, what)? as u32);
    let (slots, running, waiting) = (count("slots")?, count("running calls")?, count("waiting calls")?);
    let mut number = || from.number("a count");
    Ok(Hello {
        build,
        incarnation,
        slots,
        running,
        waiting,
        answered: number()?,
        known: number()?,
        cache: number()?,
        cache_most: number()?,
    })
}
