//! A recorded session, opened: all of its parts, whole or cut, as one.

use std::collections::{BTreeMap, BTreeSet};

use stillpoint_samples::{Cause, Entry};

use crate::account::{ClockSample, Lost};
use crate::cache::BlockCache;
use crate::form::StaticTransform;
use crate::layout::TopicKind;
use crate::opening::Attachment;
use crate::part::{SessionPart, Use};
use crate::topic::Role;

/// A topic of a session.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Topic {
    /// `operator.port`.
    pub name: String,
    /// The operator that sent it; empty where the recording does not say.
    pub operator: String,
    /// Type name with its layout hash, as recorded.
    pub type_name: String,
    /// The `ros2msg` text of the type, as recorded.
    pub schema: String,
    /// The frame of its coordinates.
    pub frame: Option<String>,
    /// What it is to replay.
    pub role: Role,
    /// What its samples are to this build.
    pub kind: TopicKind,
    /// Samples, or messages of an opaque topic, that are there.
    pub samples: u64,
    /// Their bytes as recorded, uncompressed.
    pub bytes: u64,
}

/// Which sample: number of the topic in [`Session::topics`], incarnation, sequence.
pub(crate) type SampleKey = (usize, u32, u64);

/// Where a sample is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Place {
    pub part: u32,
    pub block: u32,
    /// Of its record in the block's records.
    pub start: usize,
}

/// A session, whole or cut, of one part or many.
#[derive(Debug, Default)]
pub struct Session {
    pub(crate) parts: Vec<SessionPart>,
    pub(crate) index: BTreeMap<SampleKey, Place>,
    pub(crate) topics: Vec<Topic>,
    pub(crate) numbers: BTreeMap<String, usize>,
    pub(crate) attachments: BTreeMap<String, Attachment>,
    pub(crate) metadata: BTreeMap<String, BTreeMap<String, String>>,
    pub(crate) frames: Vec<StaticTransform>,
    pub(crate) clock: Vec<ClockSample>,
    pub(crate) lost: Vec<Lost>,
    pub(crate) journals: BTreeMap<String, Vec<Entry>>,
    pub(crate) cache: BlockCache,
}

impl Session {
    /// The topics, in the order in which they were added.
    pub fn topics(&self) -> &[Topic] {
        &self.topics
    }

    /// Number of a topic in [`Session::topics`].
    pub fn topic_number(&self, name: &str) -> Option<usize> {
        self.numbers.get(name).copied()
    }

    /// The files kept in the session, by name.
    pub fn attachments(&self) -> &BTreeMap<String, Attachment> {
        &self.attachments
    }

    /// The metadata records, by name.
    pub fn metadata(&self) -> &BTreeMap<String, BTreeMap<String, String>> {
        &self.metadata
    }

    /// The frames that do not move.
    pub fn frames(&self) -> &[StaticTransform] {
        &self.frames
    }

    /// The clock's relation to realtime, in the order of recording.
    pub fn clock(&self) -> &[ClockSample] {
        &self.clock
    }

    /// What could not be kept, as the recorder listed it.
    pub fn lost(&self) -> &[Lost] {
        &self.lost
    }

    /// Names of the channels whose messages are no samples of a topic: what viewers want beside samples, the clock, frames
    /// and losses.
    pub fn other_channels(&self) -> BTreeSet<&str> {
        let of = |part: &'_ SessionPart, id: &u16| part.counts.get(id).is_some_and(|count| *count > 0);
        let others = self.parts.iter().flat_map(|part| {
            part.channels
                .iter()
                .filter(move |(id, c)| !matches!(c.purpose, Use::Samples { .. }) && of(part, id))
        });
        others.map(|(_, c)| c.channel.topic.as_str()).collect()
    }

    /// The journals by operator, each in the order of incarnation and entry.
    pub fn journals(&self) -> &BTreeMap<String, Vec<Entry>> {
        &self.journals
    }

    /// Incarnations whose journal has no end: they died, or the recording was over before them. Operator and number.
    pub fn unended(&self) -> Vec<(&str, u32)> {
        let mut unended = Vec::new();
        for (operator, entries) in &self.journals {
            for life in entries.chunk_by(|a, b| a.header.incarnation == b.header.incarnation) {
                if let Some(last) = life.last().filter(|e| e.cause() != Some(Cause::End)) {
                    unended.push((operator.as_str(), last.header.incarnation));
                }
            }
        }
        unended
    }

    /// The incarnation and sequence of every sample of a topic, in order.
    pub fn numbers(&self, topic: usize) -> impl DoubleEndedIterator<Item = (u32, u64)> {
        self.index.range((topic, 0, 0)..=(topic, u32::MAX, u64::MAX)).map(|((_, i, s), _)| (*i, *s))
    }

    /// Incarnation and sequence of the last sample of a topic before (incarnation, sequence).
    pub(crate) fn last_before(
        &self,
        topic: usize,
        (incarnation, sequence): (u32, u64),
    ) -> Option<(u32, u64)> {
        let mut before = self.index.range((topic, 0, 0)..(topic, incarnation, sequence));
        before.next_back().map(|((_, i, s), _)| (*i, *s))
    }

    /// Whether a sample is there.
    pub fn has(&self, topic: usize, incarnation: u32, sequence: u64) -> bool {
        self.index.contains_key(&(topic, incarnation, sequence))
    }
}
