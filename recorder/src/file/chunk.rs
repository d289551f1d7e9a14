//! The chunk that is being filled.

use std::collections::BTreeMap;
use std::io::{self, Write};

use crc32fast::Hasher;

use super::put::{Put, record};
use super::record::{Message, RECORD_HEADER, op};
use crate::opening::Compression;

/// Bytes of a message's record before its data.
const MESSAGE_HEADER: usize = 22;

/// The records of a chunk so far.
#[derive(Default)]
pub(super) struct Chunk {
    records: Vec<u8>,
    /// By channel: log time and offset of each of its messages.
    index: BTreeMap<u16, Vec<(u64, u64)>>,
    bounds: Option<(u64, u64)>,
    /// Room for what is compressed.
    packed: Vec<u8>,
}

/// A chunk as it goes to the file: `header`, the stored bytes, `indexes`.
pub(super) struct Closed<'a> {
    pub header: Vec<u8>,
    pub stored: [&'a [u8]; 2],
    /// Checksum of the stored bytes where it is known.
    pub hash: Option<Hasher>,
    /// Message indexes, and where in them that of each channel stands.
    pub indexes: Vec<u8>,
    pub places: BTreeMap<u16, u64>,
    pub times: (u64, u64),
    pub compression: &'static str,
    pub uncompressed_size: u64,
}

impl Closed<'_> {
    pub fn stored_size(&self) -> u64 {
        self.stored.iter().map(|s| s.len() as u64).sum()
    }
}

impl Chunk {
    pub fn is_empty(&self) -> bool {
        self.records.is_empty()
    }

    /// Bytes of its records.
    pub fn len(&self) -> usize {
        self.records.len()
    }

    /// Adds a record that is no message.
    pub fn add(&mut self, opcode: u8, body: impl FnOnce(&mut Vec<u8>)) {
        record(&mut self.records, opcode, body);
    }

    /// Adds a message but for its data, which must come next.
    pub fn begin(&mut self, message: &Message<'_>) {
        let time = message.log_time;
        let (start, end) = self.bounds.unwrap_or((time, time));
        self.bounds = Some((start.min(time), end.max(time)));
        self.index.entry(message.channel).or_default().push((time, self.records.len() as u64));
        self.records.push(op::MESSAGE);
        self.records.u64((MESSAGE_HEADER + message.data.len()) as u64);
        self.records.u16(message.channel);
        self.records.u32(message.sequence);
        self.records.u64(time);
        self.records.u64(message.publish_time);
    }

    /// Adds the data.
    pub fn extend(&mut self, data: &[u8]) {
        self.records.extend_from_slice(data);
    }

    /// The chunk with `last` as the data of its last message, which is not copied.
    pub fn close<'a>(&'a mut self, compression: Compression, last: &'a [u8]) -> io::Result<Closed<'a>> {
        let mut hash = Hasher::new();
        hash.update(&self.records);
        hash.update(last);
        let uncompressed_size = (self.records.len() + last.len()) as u64;
        let name = match compression {
            Compression::None => "",
            Compression::Lz4 => "lz4",
            Compression::Zstd => "zstd",
        };
        let plain = compression == Compression::None;
        if !plain {
            let room = std::mem::take(&mut self.packed);
            self.packed = pack(compression, [&self.records, last], room)?;
        }
        let stored: [&[u8]; 2] = if plain { [&self.records, last] } else { [&self.packed, &[]] };
        let size = stored[0].len() + stored[1].len();
        let times = self.bounds.unwrap_or_default();
        let mut header = Vec::new();
        record(&mut header, op::CHUNK, |out| {
            out.u64(times.0);
            out.u64(times.1);
            out.u64(uncompressed_size);
            out.u32(hash.clone().finalize());
            out.text(name);
            out.u64(size as u64);
        });
        let body = (header.len() - RECORD_HEADER + size) as u64;
        header[1..RECORD_HEADER].copy_from_slice(&body.to_le_bytes());
        let (mut indexes, mut places) = (Vec::new(), BTreeMap::new());
        for (channel, messages) in &self.index {
            places.insert(*channel, indexes.len() as u64);
            record(&mut indexes, op::MESSAGE_INDEX, |out| {
                out.u16(*channel);
                out.sized(|out| {
                    for (time, offset) in messages {
                        out.u64(*time);
                        out.u64(*offset);
                    }
                });
            });
        }
        let hash = plain.then_some(hash);
        Ok(Closed { header, stored, hash, indexes, places, times, compression: name, uncompressed_size })
    }

    /// Begins the next one in the same room.
    pub fn clear(&mut self) {
        self.records.clear();
        self.index.clear();
        self.bounds = None;
    }
}

/// The bytes, compressed in one thread into `room`, whose capacity is reused.
fn pack(compression: Compression, bytes: [&[u8]; 2], mut room: Vec<u8>) -> io::Result<Vec<u8>> {
    room.clear();
    match compression {
        Compression::Zstd => {
            let mut encoder = zstd::stream::write::Encoder::new(room, 0)?;
            bytes.iter().try_for_each(|b| encoder.write_all(b))?;
            encoder.finish()
        }
        _ => {
            // The format has a checksum of its own, and some of its readers reckon that of lz4's blocks wrongly.
            let unchecked = lz4::liblz4::BlockChecksum::NoBlockChecksum;
            let mut encoder = lz4::EncoderBuilder::new().block_checksum(unchecked).build(room)?;
            bytes.iter().try_for_each(|b| encoder.write_all(b))?;
            let (packed, ended) = encoder.finish();
            ended.map(|()| packed)
        }
    }
}
