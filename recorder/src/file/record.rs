//! One MCAP record out of a slice. Every length is checked against the bytes that are there.

use std::collections::BTreeMap;

/// Opcode and length of a record.
pub(crate) const RECORD_HEADER: usize = 9;

pub(crate) mod op {
    pub const FOOTER: u8 = 0x02;
    pub const SCHEMA: u8 = 0x03;
    pub const CHANNEL: u8 = 0x04;
    pub const MESSAGE: u8 = 0x05;
    pub const CHUNK: u8 = 0x06;
    pub const ATTACHMENT: u8 = 0x09;
    pub const METADATA: u8 = 0x0c;
    pub const DATA_END: u8 = 0x0f;
}

/// A message type.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Schema {
    pub id: u16,
    pub name: String,
    pub encoding: String,
    pub data: Vec<u8>,
}

/// A stream of messages on a topic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Channel {
    pub id: u16,
    pub schema_id: u16,
    pub topic: String,
    pub encoding: String,
    pub metadata: BTreeMap<String, String>,
}

/// One message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Message<'a> {
    pub channel: u16,
    pub sequence: u32,
    pub log_time: u64,
    pub publish_time: u64,
    pub data: &'a [u8],
}

/// A file kept in the session.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct AttachmentRecord {
    pub log_time: u64,
    pub create_time: u64,
    pub name: String,
    pub media_type: String,
    pub data: Vec<u8>,
}

/// What stands before the records of a chunk.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ChunkHeader {
    pub uncompressed_size: u64,
    pub crc: u32,
    pub compression: String,
    /// Bytes of the header itself: the records start behind it.
    pub size: usize,
    pub compressed_size: u64,
}

/// The records that a session is made of. Indexes, statistics and offsets are left out: they repeat what is there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Record<'a> {
    Schema(Schema),
    Channel(Channel),
    Message(Message<'a>),
    Attachment(AttachmentRecord),
    Metadata { name: String, entries: BTreeMap<String, String> },
    Other,
}

/// Why a record cannot be read.
pub(crate) type Fault = &'static str;

/// The name of an attachment, as far as it can be read: its checksum may be wrong.
pub(crate) fn attachment_name(body: &[u8]) -> Option<String> {
    let mut c = Cursor { rest: body };
    c.take(16).ok()?;
    c.string().ok()
}

/// Walks over the bytes of a record.
struct Cursor<'a> {
    rest: &'a [u8],
}

impl<'a> Cursor<'a> {
    fn take(&mut self, n: usize) -> Result<&'a [u8], Fault> {
        let (head, rest) = self.rest.split_at_checked(n).ok_or("a length runs past the end of the record")?;
        self.rest = rest;
        Ok(head)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Fault> {
        let (head, rest) = self.rest.split_first_chunk().ok_or("the record is too short")?;
        self.rest = rest;
        Ok(*head)
    }

    fn u16(&mut self) -> Result<u16, Fault> {
        Ok(u16::from_le_bytes(self.array()?))
    }

    fn u32(&mut self) -> Result<u32, Fault> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    fn u64(&mut self) -> Result<u64, Fault> {
        Ok(u64::from_le_bytes(self.array()?))
    }

    fn string(&mut self) -> Result<String, Fault> {
        let len = self.u32()? as usize;
        let text = std::str::from_utf8(self.take(len)?).map_err(|_| "a text is not UTF-8")?;
        Ok(text.to_owned())
    }

    fn map(&mut self) -> Result<BTreeMap<String, String>, Fault> {
        let len = self.u32()? as usize;
        let mut inner = Cursor { rest: self.take(len)? };
        let mut map = BTreeMap::new();
        while !inner.rest.is_empty() {
            let key = inner.string()?;
            let value = inner.string()?;
            if map.insert(key, value).is_some() {
                return Err("a map holds one key twice");
            }
        }
        Ok(map)
    }
}

/// Opcode and length in the nine bytes before a record.
pub(crate) fn opcode_and_length(bytes: &[u8]) -> Option<(u8, u64)> {
    let (op, rest) = bytes.split_first()?;
    Some((*op, u64::from_le_bytes(*rest.first_chunk()?)))
}

/// Reads the body of a record.
pub(crate) fn parse(opcode: u8, body: &[u8]) -> Result<Record<'_>, Fault> {
    let mut c = Cursor { rest: body };
    Ok(match opcode {
        op::SCHEMA => {
            let (id, name, encoding) = (c.u16()?, c.string()?, c.string()?);
            let len = c.u32()? as usize;
            Record::Schema(Schema { id, name, encoding, data: c.take(len)?.to_vec() })
        }
        op::CHANNEL => Record::Channel(Channel {
            id: c.u16()?,
            schema_id: c.u16()?,
            topic: c.string()?,
            encoding: c.string()?,
            metadata: c.map()?,
        }),
        op::MESSAGE => Record::Message(Message {
            channel: c.u16()?,
            sequence: c.u32()?,
            log_time: c.u64()?,
            publish_time: c.u64()?,
            data: c.rest,
        }),
        op::ATTACHMENT => {
            let (log_time, create_time, name, media_type) = (c.u64()?, c.u64()?, c.string()?, c.string()?);
            let len = usize::try_from(c.u64()?).map_err(|_| "the attachment is larger than memory")?;
            let data = c.take(len)?;
            let hashed = body.len() - c.rest.len();
            let crc = c.u32()?;
            if crc != 0 && crc != crc32fast::hash(&body[..hashed]) {
                return Err("the checksum of the attachment is wrong");
            }
            Record::Attachment(AttachmentRecord {
                log_time,
                create_time,
                name,
                media_type,
                data: data.to_vec(),
            })
        }
        op::METADATA => Record::Metadata { name: c.string()?, entries: c.map()? },
        _ => Record::Other,
    })
}

/// Reads the header of a chunk, of which more bytes may follow than are given.
pub(crate) fn chunk_header(body: &[u8]) -> Result<ChunkHeader, Fault> {
    let mut c = Cursor { rest: body };
    let (_start, _end, uncompressed_size, crc) = (c.u64()?, c.u64()?, c.u64()?, c.u32()?);
    let compression = c.string()?;
    let compressed_size = c.u64()?;
    Ok(ChunkHeader { uncompressed_size, crc, compression, size: body.len() - c.rest.len(), compressed_size })
}

/// The next whole record of `bytes` at `at`, which moves behind it: the offset of its body and what reading it gave.
/// `None` where no record is there to its end.
pub(crate) fn next_record<'a>(bytes: &'a [u8], at: &mut usize) -> Option<(usize, Result<Record<'a>, Fault>)> {
    let (opcode, len) = opcode_and_length(bytes.get(*at..)?)?;
    let start = at.checked_add(RECORD_HEADER)?;
    let end = start.checked_add(usize::try_from(len).ok()?)?;
    let body = bytes.get(start..end)?;
    *at = end;
    Some((start, parse(opcode, body)))
}
