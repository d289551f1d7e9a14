//! The walk over a file that may be cut or damaged anywhere.

use std::collections::BTreeMap;
use std::io;

use super::block::Block;
use super::record::{
    AttachmentRecord, RECORD_HEADER, Record, attachment_name, chunk_header, op, opcode_and_length, parse,
};
use super::source::Source;

const MAGIC: &[u8] = &[0x89, b'M', b'C', b'A', b'P', 0x30, b'\r', b'\n'];
/// Bytes that are read at once to find the header of a chunk; its longest part is the compression's name.
const CHUNK_HEADER_READ: usize = 256;

/// Damage in a file: bytes that are not those that were written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Damage {
    /// Where it starts, in bytes from the start of the file.
    pub offset: u64,
    /// Description of the fault.
    pub what: String,
}

/// What a file holds, chunks unread.
#[derive(Debug, Default)]
pub(crate) struct Scan {
    pub attachments: Vec<AttachmentRecord>,
    pub metadata: Vec<(String, BTreeMap<String, String>)>,
    pub blocks: Vec<Block>,
    /// Schemas and channels that stand again behind the data.
    pub repeated: Vec<Block>,
    /// Where the last whole record ends.
    pub whole: u64,
    /// The file ends in a footer.
    pub footer: bool,
    pub damage: Vec<Damage>,
}

/// Walks over the records of a file. `None`: the file does not start as an MCAP file does.
pub(crate) fn scan(source: &Source) -> io::Result<Option<Scan>> {
    let size = source.size()?;
    if source.read(0, MAGIC.len())? != MAGIC {
        return Ok(None);
    }
    let mut found = Scan { whole: MAGIC.len() as u64, ..Scan::default() };
    while !found.footer {
        let at = found.whole;
        let start = source.read(at, RECORD_HEADER + CHUNK_HEADER_READ)?;
        let Some((opcode, len)) = opcode_and_length(&start) else { break };
        let body = at + RECORD_HEADER as u64;
        let there = size - body;
        if opcode == op::CHUNK {
            add_chunk(&mut found, &start[RECORD_HEADER..], body, len, there);
        }
        if len > there {
            if opcode == 0 || opcode > op::DATA_END && opcode < 0x80 {
                found.damage.push(Damage { offset: at, what: format!("no record has the number {opcode}") });
            }
            break;
        }
        match opcode {
            op::ATTACHMENT | op::METADATA => {
                let bytes = source.read(body, usize::try_from(len).unwrap_or(usize::MAX))?;
                match parse(opcode, &bytes) {
                    Ok(Record::Attachment(a)) => found.attachments.push(a),
                    Ok(Record::Metadata { name, entries }) => found.metadata.push((name, entries)),
                    Ok(_) => {}
                    Err(fault) => {
                        let name = (opcode == op::ATTACHMENT).then(|| attachment_name(&bytes)).flatten();
                        let what = match name {
                            Some(name) => format!("`{}`: {fault}", name.escape_debug()),
                            None => fault.to_owned(),
                        };
                        found.damage.push(Damage { offset: at, what });
                    }
                }
            }
            op::SCHEMA | op::CHANNEL | op::MESSAGE => {
                found.blocks.push(Block::of_record(at, len));
            }
            // What follows repeats what came before.
            op::DATA_END => {
                found.footer = ends_in_footer(source, size)?;
                found.whole = body + len;
                found.repeated = repeated(source, found.whole, size)?;
                break;
            }
            op::FOOTER => found.footer = true,
            _ => {}
        }
        found.whole = body + len;
    }
    Ok(Some(found))
}

/// The schemas and channels that begin at `at`.
fn repeated(source: &Source, mut at: u64, size: u64) -> io::Result<Vec<Block>> {
    let mut found = Vec::new();
    while let Some((op::SCHEMA | op::CHANNEL, len)) = opcode_and_length(&source.read(at, RECORD_HEADER)?) {
        let end = (at + RECORD_HEADER as u64).checked_add(len).filter(|end| *end <= size);
        let Some(end) = end else { break };
        found.push(Block::of_record(at, len));
        at = end;
    }
    Ok(found)
}

fn add_chunk(found: &mut Scan, bytes: &[u8], body: u64, len: u64, there: u64) {
    let at = body - RECORD_HEADER as u64;
    let visible = &bytes[..bytes.len().min(usize::try_from(len).unwrap_or(usize::MAX))];
    let header = match chunk_header(visible) {
        Ok(header) => header,
        // A header that is cut off is no damage.
        Err(_) if len > there => return,
        Err(fault) => {
            found.damage.push(Damage { offset: at, what: fault.to_owned() });
            return;
        }
    };
    if (header.size as u64).checked_add(header.compressed_size).is_none_or(|n| n > len) {
        let what = format!("a chunk of {} bytes is in a record of {len}", header.compressed_size);
        found.damage.push(Damage { offset: at, what });
        return;
    }
    let offset = body + header.size as u64;
    match Block::of_chunk(&header, offset, there - header.size as u64) {
        Ok(block) => found.blocks.push(block),
        Err(fault) => found.damage.push(Damage { offset: at, what: fault.to_string() }),
    }
}

/// Whether a whole footer record stands before the magic bytes at the end.
fn ends_in_footer(source: &Source, size: u64) -> io::Result<bool> {
    const FOOTER: usize = RECORD_HEADER + 20;
    let tail = FOOTER + MAGIC.len();
    let bytes = source.read(size.saturating_sub(tail as u64), tail)?;
    Ok(bytes.len() == tail
        && bytes.ends_with(MAGIC)
        && opcode_and_length(&bytes) == Some((op::FOOTER, (FOOTER - RECORD_HEADER) as u64)))
}
