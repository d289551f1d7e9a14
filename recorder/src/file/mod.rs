//! An MCAP file as bytes: records, chunks, and the walk over both. Nothing here panics or trusts a length.
//!
//! - `buffer`: bytes whose room is kept from one use to the next
//! - `source`: bytes in memory or in a file, read by offset
//! - `record`: one record out of a slice
//! - `block`: the records of one chunk, decompressed within bounds
//! - `frame`: the header of an LZ4 frame
//! - `scan`: the walk over a file that may be cut or damaged anywhere
//! - `write`, `chunk`, `summary`, `put`: a file, written: its chunks, what stands behind them, the fields of its records

mod block;
mod buffer;
mod chunk;
mod frame;
mod put;
mod record;
mod scan;
mod source;
mod summary;
mod write;

pub(crate) use block::{Block, Loaded};
pub(crate) use buffer::Buffer;
pub(crate) use record::{AttachmentRecord, Channel, Message, Record, Schema, next_record};
pub(crate) use scan::{Damage, MAGIC, Scan, scan};
pub use source::Source;
pub use write::CHUNK_SIZE;
pub(crate) use write::FileWriter;
