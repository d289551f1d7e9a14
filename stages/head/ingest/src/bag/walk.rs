//! The messages of an MCAP file, with its checksums compared and with bounds on what it unpacks to.

use std::sync::Arc;

use mcap::read::ChannelAccumulator;
use mcap::records::{MessageHeader, Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{Channel, McapError};

use crate::checks::quoted;

/// Bytes to which any file may unpack.
const FREE: usize = 128 << 20;
/// Bytes to which a byte of a file may unpack: what sensors record shrinks far less.
const PER_BYTE: usize = 64;

/// A message of a recording.
#[derive(Clone, Debug)]
pub struct Message {
    /// Its channel.
    pub channel: Arc<Channel<'static>>,
    /// Its number, its time in the recording, and that of its sender.
    pub header: MessageHeader,
    /// Its bytes.
    pub data: Vec<u8>,
}

/// Why a file of a recording is not read.
#[derive(Debug, thiserror::Error)]
#[error("{name}: {fault}")]
pub struct WalkError {
    name: String,
    fault: WalkFault,
}

/// What is wrong with a file of a recording.
#[derive(Debug, thiserror::Error)]
enum WalkFault {
    #[error("it is empty (0 bytes)")]
    Empty,
    #[error(
        "it unpacks to more than {} MB (allowed: {} MB, and {PER_BYTE} times the size of the file): write it with less \
         compression",
        most / 1_000_000,
        FREE / 1_000_000
    )]
    TooLarge { most: usize },
    #[error("it is compressed as a whole by zstd: unpack it with `zstd -d`")]
    Zstd,
    #[error(
        "it is not an MCAP file but a bag of ROS 1: convert it with `rosbags-convert --src BAG --dst NEW --dst-storage mcap`"
    )]
    Ros1,
    #[error("it is not an MCAP file")]
    Magic,
    #[error("it ends in the middle of a record: {REPAIR}")]
    Truncated,
    #[error("its bytes are not those that were recorded: {0}: {REPAIR}")]
    Checksum(McapError),
    #[error(
        "two channels of one number differ, one of them of {}: it is damaged, or two files were joined",
        quoted(.0)
    )]
    Channels(String),
    #[error("{}", quoted(&.0.to_string()))]
    Other(McapError),
}

const REPAIR: &str = "repair a copy of it with `stillpoint recover`";

impl WalkFault {
    /// What it means for people that the library cannot read the file of this name, which may unpack to `most` bytes.
    fn of(error: McapError, name: &str, most: usize) -> Self {
        match error {
            McapError::BadMagic => match name.rsplit_once('.') {
                Some((_, "zstd" | "zst")) => Self::Zstd,
                Some((_, "bag")) => Self::Ros1,
                _ => Self::Magic,
            },
            McapError::UnexpectedEof => Self::Truncated,
            McapError::BadChunkCrc { .. } | McapError::BadDataCrc { .. } => Self::Checksum(error),
            McapError::RecordTooLarge { .. } => Self::TooLarge { most },
            McapError::ConflictingChannels(topic) => Self::Channels(topic),
            other => Self::Other(other),
        }
    }
}

/// Walks over the messages of a file in the order in which they were written.
pub struct Walk<'a> {
    name: &'a str,
    rest: &'a [u8],
    reader: LinearReader,
    channels: ChannelAccumulator<'static>,
    /// Bytes that may still be unpacked, and those that the file could unpack to.
    left: usize,
    most: usize,
    is_empty: bool,
    is_past_data: bool,
    is_done: bool,
}

impl<'a> Walk<'a> {
    /// Over the file of this name. Chunks and the data section are compared with their checksums.
    pub fn new(name: &'a str, bytes: &'a [u8]) -> Self {
        let most = FREE.saturating_add(bytes.len().saturating_mul(PER_BYTE));
        let options = LinearReaderOptions::default()
            .with_validate_chunk_crcs(true)
            .with_validate_data_section_crc(true)
            .with_record_length_limit(most);
        Self {
            name,
            rest: bytes,
            reader: LinearReader::new_with_options(options),
            channels: ChannelAccumulator::default(),
            left: most,
            most,
            is_empty: bytes.is_empty(),
            is_past_data: false,
            is_done: false,
        }
    }

    fn advance(&mut self) -> Result<Option<Message>, WalkFault> {
        if self.is_empty {
            return Err(WalkFault::Empty);
        }
        let (name, most) = (self.name, self.most);
        let fault = |e: McapError| WalkFault::of(e, name, most);
        while let Some(event) = self.reader.next_event() {
            let (opcode, data) = match event.map_err(fault)? {
                LinearReadEvent::ReadRequest(need) => {
                    let (taken, rest) = self.rest.split_at(need.min(self.rest.len()));
                    self.reader.insert(taken.len()).copy_from_slice(taken);
                    self.reader.notify_read(taken.len());
                    self.rest = rest;
                    continue;
                }
                LinearReadEvent::Record { opcode, data } => (opcode, data),
            };
            self.left = self.left.checked_sub(data.len()).ok_or(WalkFault::TooLarge { most })?;
            // The summary repeats schemas and channels; its statistics are not believed.
            let is_read = [op::SCHEMA, op::CHANNEL, op::MESSAGE, op::DATA_END].contains(&opcode);
            if self.is_past_data || !is_read {
                continue;
            }
            match mcap::parse_record(opcode, data).map_err(fault)? {
                Record::Schema { header, data } => {
                    self.channels.add_schema_from_slice(header, &data).map_err(fault)?;
                }
                Record::Channel(channel) => self.channels.add_channel(channel).map_err(fault)?,
                Record::Message { header, data } => {
                    let unknown = || fault(McapError::UnknownChannel(header.sequence, header.channel_id));
                    let channel = self.channels.get(header.channel_id).ok_or_else(unknown)?;
                    return Ok(Some(Message { channel, header, data: data.into_owned() }));
                }
                Record::DataEnd(_) => self.is_past_data = true,
                _ => {}
            }
        }
        Ok(None)
    }
}

impl Iterator for Walk<'_> {
    type Item = Result<Message, WalkError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.is_done {
            return None;
        }
        let found = self.advance();
        self.is_done = !matches!(found, Ok(Some(_)));
        found.map_err(|fault| WalkError { name: self.name.to_owned(), fault }).transpose()
    }
}
