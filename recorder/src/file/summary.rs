//! What stands behind the data of a file, so that a reader finds a place in it without reading all: what the file holds,
//! and where.

use std::collections::BTreeMap;

use super::chunk::Closed;
use super::put::{Put, record};
use super::record::{AttachmentRecord, Channel, Message, Schema, op};
use super::write::{put_channel, put_schema};

/// Bytes of a footer before its checksum, which covers them.
const FOOTER: u64 = 20;

/// What a file holds so far.
#[derive(Default)]
pub(super) struct Summary {
    pub schemas: BTreeMap<u16, Schema>,
    pub channels: BTreeMap<u16, Channel>,
    /// Messages of each channel.
    messages: BTreeMap<u16, u64>,
    times: Option<(u64, u64)>,
    /// Records, laid out.
    chunks: Indexes,
    attachments: Indexes,
    metadata: Indexes,
}

/// Index records of one sort.
#[derive(Default)]
struct Indexes {
    bytes: Vec<u8>,
    count: u32,
}

impl Indexes {
    fn add(&mut self, opcode: u8, body: impl FnOnce(&mut Vec<u8>)) {
        record(&mut self.bytes, opcode, body);
        self.count += 1;
    }
}

impl Summary {
    pub fn count(&mut self, message: &Message<'_>) {
        *self.messages.entry(message.channel).or_default() += 1;
        let (start, end) = self.times.unwrap_or((message.log_time, message.log_time));
        self.times = Some((start.min(message.log_time), end.max(message.log_time)));
    }

    /// A chunk at `offset` whose message indexes stand at `indexes`.
    pub fn chunk(&mut self, offset: u64, indexes: u64, chunk: &Closed<'_>) {
        let places = chunk.places.iter().map(|(channel, at)| (*channel, indexes + at)).collect();
        self.chunks.add(op::CHUNK_INDEX, |out| {
            out.u64(chunk.times.0);
            out.u64(chunk.times.1);
            out.u64(offset);
            out.u64(indexes - offset);
            out.numbers(&places);
            out.u64(chunk.indexes.len() as u64);
            out.text(chunk.compression);
            out.u64(chunk.stored_size());
            out.u64(chunk.uncompressed_size);
        });
    }

    pub fn attachment(&mut self, offset: u64, length: u64, a: &AttachmentRecord) {
        self.attachments.add(op::ATTACHMENT_INDEX, |out| {
            out.u64(offset);
            out.u64(length);
            out.u64(a.log_time);
            out.u64(a.create_time);
            out.u64(a.data.len() as u64);
            out.text(&a.name);
            out.text(&a.media_type);
        });
    }

    pub fn metadata(&mut self, offset: u64, length: u64, name: &str) {
        self.metadata.add(op::METADATA_INDEX, |out| {
            out.u64(offset);
            out.u64(length);
            out.text(name);
        });
    }

    /// The summary section of a file whose data ends at `start`, with its footer.
    pub fn lay_out(&self, start: u64) -> Vec<u8> {
        let mut out = Vec::new();
        let mut groups = Vec::new();
        let mut end_group = |opcode: u8, out: &Vec<u8>| {
            let before = groups.last().map_or(0, |(_, _, end)| *end);
            if out.len() > before {
                groups.push((opcode, before, out.len()));
            }
        };
        for schema in self.schemas.values() {
            record(&mut out, op::SCHEMA, |out| put_schema(schema, out));
        }
        end_group(op::SCHEMA, &out);
        for channel in self.channels.values() {
            record(&mut out, op::CHANNEL, |out| put_channel(channel, out));
        }
        end_group(op::CHANNEL, &out);
        record(&mut out, op::STATISTICS, |out| self.statistics(out));
        end_group(op::STATISTICS, &out);
        for (opcode, indexes) in [
            (op::CHUNK_INDEX, &self.chunks),
            (op::ATTACHMENT_INDEX, &self.attachments),
            (op::METADATA_INDEX, &self.metadata),
        ] {
            out.extend_from_slice(&indexes.bytes);
            end_group(opcode, &out);
        }
        let offsets = start + out.len() as u64;
        for (opcode, from, to) in groups {
            record(&mut out, op::SUMMARY_OFFSET, |out| {
                out.push(opcode);
                out.u64(start + from as u64);
                out.u64((to - from) as u64);
            });
        }
        // The checksum covers the footer up to itself.
        out.push(op::FOOTER);
        out.u64(FOOTER);
        out.u64(start);
        out.u64(offsets);
        out.u32(crc32fast::hash(&out));
        out
    }

    fn statistics(&self, out: &mut Vec<u8>) {
        let times = self.times.unwrap_or_default();
        out.u64(self.messages.values().sum());
        out.u16(self.schemas.len() as u16);
        out.u32(self.channels.len() as u32);
        out.u32(self.attachments.count);
        out.u32(self.metadata.count);
        out.u32(self.chunks.count);
        out.u64(times.0);
        out.u64(times.1);
        out.numbers(&self.messages);
    }
}
