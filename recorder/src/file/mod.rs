//! An MCAP file as bytes: records, chunks, and the walk over both. This code never panics and never trusts a length.
//!
//! - `buffer`: bytes whose room is kept from one use to the next
//! - `source`: bytes in memory or in a file, read by offset
//! - `record`: one record out of a slice
//! - `block`: the records of one chunk, decompressed within bounds
//! - `frame`: the header of an LZ4 frame
//! - `scan`: the walk over a file that may be cut or damaged anywhere

mod block;
mod buffer;
mod frame;
mod record;
mod scan;
mod source;

pub(crate) use block::{Block, Loaded};
pub(crate) use buffer::Buffer;
pub(crate) use record::{Channel, Message, Record, Schema, next_record};
pub(crate) use scan::{Damage, Scan, scan};
pub use source::Source;
