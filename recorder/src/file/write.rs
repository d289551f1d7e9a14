//! Writes an MCAP file from front to back.

use std::collections::BTreeMap;
use std::io::{self, BufWriter, Write};

use crc32fast::Hasher;

use super::chunk::Chunk;
use super::put::{Put, record};
use super::record::{AttachmentRecord, Channel, Message, Schema, op};
use super::scan::MAGIC;
use super::summary::Summary;
use crate::opening::Compression;

/// Bytes after which a chunk is closed.
pub const CHUNK_SIZE: u64 = 1 << 20;
/// What is shorter waits until so much is there, so that small records do not cost a call each.
const WAITING: usize = 1 << 16;

/// Writes an MCAP file from front to back. Chunks, indexes and checksums are those of the format's own writer; but the
/// sample that fills its chunk goes to the file from where it lies, and what is stored as it is, is hashed once.
///
/// Dropping it leaves the file as it is: cut.
pub(crate) struct FileWriter<W: Write> {
    file: BufWriter<W>,
    position: u64,
    hash: Hasher,
    compression: Compression,
    chunk: Chunk,
    summary: Summary,
    /// An error of the file that was: what came after it would stand at a wrong place.
    broken: bool,
}

impl<W: Write> FileWriter<W> {
    /// Begins a file.
    pub fn new(w: W, compression: Compression, library: &str) -> io::Result<Self> {
        let mut new = Self {
            file: BufWriter::with_capacity(WAITING, w),
            position: 0,
            hash: Hasher::new(),
            compression,
            chunk: Chunk::default(),
            summary: Summary::default(),
            broken: false,
        };
        new.put(&MAGIC)?;
        new.put_record(op::HEADER, |out| {
            out.text("ros2");
            out.text(library);
        })?;
        Ok(new)
    }

    /// The number of this schema, which is written where it is new.
    pub fn schema(&mut self, name: &str, encoding: &str, data: &[u8]) -> io::Result<u16> {
        let known = self.summary.schemas.values();
        if let Some(s) =
            known.into_iter().find(|s| (&*s.name, &*s.encoding, &*s.data) == (name, encoding, data))
        {
            return Ok(s.id);
        }
        let id = next(self.summary.schemas.keys().next_back(), "schemas")?;
        self.add_schema(Schema {
            id,
            name: name.to_owned(),
            encoding: encoding.to_owned(),
            data: data.to_owned(),
        });
        Ok(id)
    }

    /// The number of a new channel.
    pub fn channel(
        &mut self,
        schema_id: u16,
        topic: &str,
        encoding: &str,
        metadata: &BTreeMap<String, String>,
    ) -> io::Result<u16> {
        let id = next(self.summary.channels.keys().next_back(), "channels")?;
        let (topic, encoding, metadata) = (topic.to_owned(), encoding.to_owned(), metadata.clone());
        self.add_channel(Channel { id, schema_id, topic, encoding, metadata });
        Ok(id)
    }

    /// Adds a schema whose number is given.
    pub fn add_schema(&mut self, schema: Schema) {
        self.chunk.add(op::SCHEMA, |out| put_schema(&schema, out));
        self.summary.schemas.insert(schema.id, schema);
    }

    /// Adds a channel whose number is given.
    pub fn add_channel(&mut self, channel: Channel) {
        self.chunk.add(op::CHANNEL, |out| put_channel(&channel, out));
        self.summary.channels.insert(channel.id, channel);
    }

    /// Writes a message.
    pub fn message(&mut self, message: &Message<'_>) -> io::Result<()> {
        self.summary.count(message);
        self.chunk.begin(message);
        if (self.chunk.len() + message.data.len()) as u64 > CHUNK_SIZE {
            return self.close_chunk(message.data);
        }
        self.chunk.extend(message.data);
        Ok(())
    }

    /// Writes an attachment.
    pub fn attach(&mut self, a: &AttachmentRecord) -> io::Result<()> {
        self.close_chunk(&[])?;
        let offset = self.position;
        self.put_record(op::ATTACHMENT, |out| {
            let start = out.len();
            out.u64(a.log_time);
            out.u64(a.create_time);
            out.text(&a.name);
            out.text(&a.media_type);
            out.u64(a.data.len() as u64);
            out.extend_from_slice(&a.data);
            out.u32(crc32fast::hash(&out[start..]));
        })?;
        let length = self.position - offset;
        self.summary.attachment(offset, length, a);
        Ok(())
    }

    /// Writes a metadata record.
    pub fn metadata(&mut self, name: &str, entries: &BTreeMap<String, String>) -> io::Result<()> {
        self.close_chunk(&[])?;
        let offset = self.position;
        self.put_record(op::METADATA, |out| {
            out.text(name);
            out.texts(entries);
        })?;
        let length = self.position - offset;
        self.summary.metadata(offset, length, name);
        Ok(())
    }

    /// Closes the chunk and flushes the file.
    pub fn flush(&mut self) -> io::Result<()> {
        self.close_chunk(&[])?;
        self.file.flush()
    }

    /// Writes the summary and gives the `Write` back.
    pub fn finish(mut self) -> io::Result<W> {
        self.close_chunk(&[])?;
        let crc = self.hash.clone().finalize();
        self.put_record(op::DATA_END, |out| out.u32(crc))?;
        let summary = self.summary.lay_out(self.position);
        self.put(&summary)?;
        self.put(&MAGIC)?;
        self.file.into_inner().map_err(io::IntoInnerError::into_error)
    }

    fn close_chunk(&mut self, last: &[u8]) -> io::Result<()> {
        if self.chunk.is_empty() {
            return Ok(());
        }
        let mut chunk = std::mem::take(&mut self.chunk);
        let closed = chunk.close(self.compression, last).inspect_err(|_| self.broken = true)?;
        let offset = self.position;
        self.put(&closed.header)?;
        for (i, stored) in closed.stored.iter().enumerate() {
            match &closed.hash {
                // Of both pieces: it is joined once.
                Some(hash) if i == 0 => self.hash.combine(hash),
                Some(_) => {}
                None => self.hash.update(stored),
            }
            self.write(stored)?;
        }
        let indexes = self.position;
        self.put(&closed.indexes)?;
        self.summary.chunk(offset, indexes, &closed);
        chunk.clear();
        self.chunk = chunk;
        Ok(())
    }

    fn put_record(&mut self, opcode: u8, body: impl FnOnce(&mut Vec<u8>)) -> io::Result<()> {
        let mut bytes = Vec::new();
        record(&mut bytes, opcode, body);
        self.put(&bytes)
    }

    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.hash.update(bytes);
        self.write(bytes)
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        if self.broken {
            return Err(io::Error::other("an earlier write to this file failed"));
        }
        self.position += bytes.len() as u64;
        self.file.write_all(bytes).inspect_err(|_| self.broken = true)
    }
}

/// The number after the last one.
fn next(last: Option<&u16>, what: &str) -> io::Result<u16> {
    let next = last.map_or(Some(1), |id| id.checked_add(1));
    next.ok_or_else(|| io::Error::other(format!("a file holds at most {} {what}", u16::MAX)))
}

pub(super) fn put_schema(schema: &Schema, out: &mut Vec<u8>) {
    out.u16(schema.id);
    out.text(&schema.name);
    out.text(&schema.encoding);
    out.u32(schema.data.len() as u32);
    out.extend_from_slice(&schema.data);
}

pub(super) fn put_channel(channel: &Channel, out: &mut Vec<u8>) {
    out.u16(channel.id);
    out.u16(channel.schema_id);
    out.text(&channel.topic);
    out.text(&channel.encoding);
    out.texts(&channel.metadata);
}

#[cfg(test)]
mod tests;
