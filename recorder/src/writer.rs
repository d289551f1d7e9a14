//! Writes one part of a session to any `Write`. It reads no clock and opens no file: two writes of the same input give
//! the same bytes.

use std::borrow::Cow;
use std::io::Write;

use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use stillpoint_samples::{BytesError, Pieces};

use crate::account::{
    CLOCK_CHANNEL, ClockSample, Closing, END_RECORD, FRAMES_CHANNEL, LEDGER_ATTACHMENT, LOST_CHANNEL, Lost,
};
use crate::channels::{Out, Topic, add_channel, add_transforms, qos};
use crate::encoded::Encoded;
use crate::error::with_causes;
use crate::form::{Companion, schema, transforms_message};
use crate::opening::{Compression, Opening};
use crate::topic::{TOPIC_RECORD, TopicInfo};

/// Bytes after which a chunk is closed.
pub const CHUNK_SIZE: u64 = 1 << 20;

/// Why a part could not be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// The file took no more bytes, or refused them.
    #[error("cannot write the recording: {}; what was flushed before is readable", with_causes(.0))]
    Mcap(#[from] mcap::McapError),
    /// The bytes given are no sample of the topic.
    #[error("topic `{topic}`: {fault}")]
    Sample {
        /// The topic.
        topic: String,
        /// What is wrong with the bytes.
        fault: BytesError,
    },
    /// Two topics of one name.
    #[error("topic `{0}` is in the recording already: name each topic once")]
    Twice(String),
    /// The topic is of another writer, or the sample of another topic.
    #[error(
        "topic number {0} of this recording is another, or was never added: write each sample to its own topic"
    )]
    NoTopic(usize),
}

/// A topic of a [`PartWriter`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct TopicId(usize);

/// Writes one part. Dropping it ends the file in order but writes no end record: the session then counts as cut.
pub struct PartWriter<W: Write> {
    out: Out<W>,
    topics: Vec<Topic>,
    lost_channel: u16,
    clock_channel: u16,
    notes: u32,
    lost: u64,
    /// Publish time of the last message on `/tf`, ns.
    moved: u64,
    /// The channel of `/tf`, once a pose was written: one for all topics, as viewers expect of a name.
    transforms: Option<u16>,
    message: Vec<u8>,
}

impl<W: Write> PartWriter<W> {
    /// Starts a part with its attachments and metadata, and flushes them.
    ///
    /// # Errors
    /// The file could not be written.
    pub fn new(w: W, compression: Compression, opening: &Opening) -> Result<Self, WriteError> {
        let options = mcap::WriteOptions::new()
            .profile("ros2")
            .library(concat!("stillpoint-recorder/", env!("CARGO_PKG_VERSION")))
            .chunk_size(Some(CHUNK_SIZE))
            .disable_seeking(true)
            // Threads of its own would compete with the operators, and their number would show in the bytes.
            .compression_threads(0)
            .compression(match compression {
                Compression::None => None,
                Compression::Lz4 => Some(mcap::Compression::Lz4),
                Compression::Zstd => Some(mcap::Compression::Zstd),
            });
        let mut out = options.create(NoSeek::new(w))?;
        let start = opening.clock.map_or(0, |c| c.realtime_ns);
        for a in &opening.attachments {
            attach(&mut out, &a.name, &a.media_type, &a.bytes, start)?;
        }
        for (name, entries) in &opening.metadata {
            out.write_metadata(&Metadata { name: name.clone(), metadata: entries.clone() })?;
        }
        let lost_channel = add_channel(&mut out, LOST_CHANNEL, schema::LOST, &qos())?;
        let clock_channel = add_channel(&mut out, CLOCK_CHANNEL, schema::CLOCK, &qos())?;
        let frames_channel = add_channel(&mut out, FRAMES_CHANNEL, schema::TRANSFORMS, &qos())?;
        let mut part = Self {
            out,
            topics: Vec::new(),
            lost_channel,
            clock_channel,
            notes: 0,
            lost: 0,
            moved: 0,
            transforms: None,
            message: Vec::new(),
        };
        if !opening.frames.is_empty() {
            let stamp = opening.clock.map_or(0, |c| c.logical_ns);
            part.message = transforms_message(stamp, &opening.frames);
            part.put(frames_channel, 0, start, start)?;
        }
        if let Some(clock) = opening.clock {
            part.clock(clock)?;
        }
        part.flush()?;
        Ok(part)
    }

    /// Adds a topic. Add all of them before the first sample: each ends the chunk that is open.
    ///
    /// # Errors
    /// A topic of that name is there already, or what writing answers.
    pub fn add_topic(&mut self, info: TopicInfo) -> Result<TopicId, WriteError> {
        if self.topics.iter().any(|t| t.info.name == info.name) {
            return Err(WriteError::Twice(info.name));
        }
        self.out.write_metadata(&Metadata { name: TOPIC_RECORD.to_owned(), metadata: info.entries() })?;
        self.topics.push(Topic::new(info));
        Ok(TopicId(self.topics.len() - 1))
    }

    /// Writes a sample. `log_time_ns` is realtime, ns since the epoch: it is for people and is never compared.
    ///
    /// # Errors
    /// The bytes are no sample of the topic's kind, or what writing answers.
    pub fn write(&mut self, topic: TopicId, sample: Pieces<'_>, log_time_ns: u64) -> Result<(), WriteError> {
        let t = self.topics.get(topic.0).ok_or(WriteError::NoTopic(topic.0))?;
        let encoded = Encoded::new(&t.info, sample, std::mem::take(&mut self.message))
            .map_err(|fault| WriteError::Sample { topic: t.info.name.clone(), fault })?;
        let written = self.write_encoded(topic, &encoded, log_time_ns);
        self.message = encoded.into_buffer();
        written
    }

    /// Writes a sample that is laid out already for this topic.
    ///
    /// # Errors
    /// The file could not be written.
    pub fn write_encoded(
        &mut self,
        topic: TopicId,
        sample: &Encoded,
        log_time_ns: u64,
    ) -> Result<(), WriteError> {
        let t = self.topics.get_mut(topic.0).ok_or(WriteError::NoTopic(topic.0))?;
        if sample.kind != t.info.kind {
            return Err(WriteError::NoTopic(topic.0));
        }
        let own;
        let sample = if t.has_room(sample.form, &sample.shared) {
            sample
        } else {
            own = sample.in_own_form(&t.info).ok_or(WriteError::NoTopic(topic.0))?;
            &own
        };
        let header = |channel_id, publish_time| MessageHeader {
            channel_id,
            sequence: sample.header.sequence as u32,
            log_time: log_time_ns,
            publish_time,
        };
        let stamp = sample.header.stamp;
        let channel = t.channel(&mut self.out, sample.form, sample.shared.clone())?;
        self.out.write_to_known_channel(&header(channel, stamp), sample.message())?;
        for (companion, message) in sample.companion() {
            let (channel, published) = match companion {
                Companion::CameraInfo | Companion::PoseStamped => {
                    (t.companion_channel(&mut self.out, companion, sample)?, stamp)
                }
                // Samples of different topics, which share `/tf`, do not come in the order of their stamps.
                Companion::Transform => {
                    let channel = match self.transforms {
                        Some(channel) => channel,
                        None => add_transforms(&mut self.out)?,
                    };
                    self.transforms = Some(channel);
                    self.moved = self.moved.max(stamp);
                    (channel, self.moved)
                }
            };
            self.out.write_to_known_channel(&header(channel, published), message)?;
        }
        Ok(())
    }

    /// Lists samples that could not be kept.
    ///
    /// # Errors
    /// The file could not be written.
    pub fn note_lost(
        &mut self,
        topic: TopicId,
        incarnation: u32,
        first: u64,
        count: u64,
        log_time_ns: u64,
    ) -> Result<(), WriteError> {
        let t = self.topics.get(topic.0).ok_or(WriteError::NoTopic(topic.0))?;
        let lost = Lost { topic: t.info.name.clone(), incarnation, first, count };
        self.lost = self.lost.saturating_add(count);
        self.message.clear();
        lost.encode(&mut self.message);
        self.note(self.lost_channel, log_time_ns)
    }

    /// Writes how the session's time stands to realtime.
    ///
    /// # Errors
    /// The file could not be written.
    pub fn clock(&mut self, sample: ClockSample) -> Result<(), WriteError> {
        self.message.clear();
        sample.encode(&mut self.message);
        self.note(self.clock_channel, sample.realtime_ns)
    }

    /// Closes the chunk and flushes the file: all that was written so far survives the process.
    ///
    /// # Errors
    /// The file could not be written.
    pub fn flush(&mut self) -> Result<(), WriteError> {
        Ok(self.out.flush()?)
    }

    /// Ends the session in order and gives the `Write` back.
    ///
    /// # Errors
    /// The file could not be written; the session then counts as cut.
    pub fn finish(mut self, closing: &Closing) -> Result<W, WriteError> {
        if let Some(ledger) = &closing.ledger {
            attach(&mut self.out, LEDGER_ATTACHMENT, "application/json", ledger, closing.realtime_ns)?;
        }
        let end = Metadata { name: END_RECORD.to_owned(), metadata: closing.entries(self.lost) };
        self.out.write_metadata(&end)?;
        self.out.finish()?;
        Ok(self.out.into_inner().into_inner())
    }

    fn note(&mut self, channel: u16, log_time_ns: u64) -> Result<(), WriteError> {
        let number = self.notes;
        self.notes = number.wrapping_add(1);
        self.put(channel, number, log_time_ns, log_time_ns)
    }

    fn put(
        &mut self,
        channel_id: u16,
        sequence: u32,
        log_time: u64,
        publish_time: u64,
    ) -> Result<(), WriteError> {
        let header = MessageHeader { channel_id, sequence, log_time, publish_time };
        Ok(self.out.write_to_known_channel(&header, &self.message)?)
    }
}

fn attach<W: Write>(
    out: &mut Out<W>,
    name: &str,
    media_type: &str,
    bytes: &[u8],
    time: u64,
) -> Result<(), WriteError> {
    Ok(out.attach(&mcap::Attachment {
        log_time: time,
        create_time: time,
        name: name.to_owned(),
        media_type: media_type.to_owned(),
        data: Cow::Borrowed(bytes),
    })?)
}
