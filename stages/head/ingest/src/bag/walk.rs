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

    fn advance(&mut self) -> Option<Result<Message, String>> {
        if self.is_empty {
            return Some(Err(format!("{}: it is empty (0 bytes)", self.name)));
        }
        while let Some(event) = self.reader.next_event() {
            let (opcode, data) = match event {
                Err(fault) => return Some(Err(unread(self.name, &fault, self.most))),
                Ok(LinearReadEvent::ReadRequest(need)) => {
                    let (taken, rest) = self.rest.split_at(need.min(self.rest.len()));
                    self.reader.insert(taken.len()).copy_from_slice(taken);
                    self.reader.notify_read(taken.len());
                    self.rest = rest;
                    continue;
                }
                Ok(LinearReadEvent::Record { opcode, data }) => (opcode, data),
            };
            let Some(left) = self.left.checked_sub(data.len()) else {
                return Some(Err(too_large(self.name, self.most)));
            };
            self.left = left;
            let fault = |e: McapError| Some(Err(unread(self.name, &e, self.most)));
            // The summary repeats schemas and channels; its statistics are not believed.
            let is_read = [op::SCHEMA, op::CHANNEL, op::MESSAGE, op::DATA_END].contains(&opcode);
            if self.is_past_data || !is_read {
                continue;
            }
            let record = match mcap::parse_record(opcode, data) {
                Ok(record) => record,
                Err(e) => return fault(e),
            };
            let added = match record {
                Record::Schema { header, data } => self.channels.add_schema_from_slice(header, &data),
                Record::Channel(channel) => self.channels.add_channel(channel),
                Record::Message { header, data } => {
                    let Some(channel) = self.channels.get(header.channel_id) else {
                        return fault(McapError::UnknownChannel(header.sequence, header.channel_id));
                    };
                    return Some(Ok(Message { channel, header, data: data.into_owned() }));
                }
                Record::DataEnd(_) => {
                    self.is_past_data = true;
                    Ok(())
                }
                _ => Ok(()),
            };
            if let Err(e) = added {
                return fault(e);
            }
        }
        None
    }
}

impl Iterator for Walk<'_> {
    type Item = Result<Message, String>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.is_done {
            return None;
        }
        let found = self.advance();
        self.is_done = !matches!(found, Some(Ok(_)));
        found
    }
}

fn too_large(name: &str, most: usize) -> String {
    format!(
        "{name}: it unpacks to more than {} MB (allowed: {} MB, and {PER_BYTE} times the size of the file): write it with less \
         compression",
        most / 1_000_000,
        FREE / 1_000_000
    )
}

/// Why a file is not read.
fn unread(name: &str, fault: &McapError, most: usize) -> String {
    let repair = "repair a copy of it with `stillpoint recover`";
    match fault {
        McapError::BadMagic => match name.rsplit_once('.') {
            Some((_, "zstd" | "zst")) => {
                format!("{name}: it is compressed as a whole by zstd: unpack it with `zstd -d`")
            }
            Some((_, "bag")) => format!(
                "{name}: it is not an MCAP file but a bag of ROS 1: convert it with `rosbags-convert --src BAG --dst NEW \
                 --dst-storage mcap`"
            ),
            _ => format!("{name}: it is not an MCAP file"),
        },
        McapError::UnexpectedEof => format!("{name}: it ends in the middle of a record: {repair}"),
        McapError::BadChunkCrc { .. } | McapError::BadDataCrc { .. } => {
            format!("{name}: its bytes are not those that were recorded: {fault}: {repair}")
        }
        McapError::RecordTooLarge { .. } => too_large(name, most),
        McapError::ConflictingChannels(topic) => format!(
            "{name}: two channels of one number differ, one of them of {}: it is damaged, or two files were joined",
            quoted(topic)
        ),
        other => format!("{name}: {}", quoted(&other.to_string())),
    }
}
