//! The records of one chunk, decompressed within bounds.

use std::io::{self, Read};

use super::buffer::Buffer;
use super::frame::without_checksum;
use super::record::{ChunkHeader, RECORD_HEADER};
use super::source::Source;

/// No chunk may grow beyond this: a chunk is 1 MiB and one sample.
const LARGEST_CHUNK: u64 = 1 << 30;
/// lz4 turns one byte into at most 255.
const LZ4_RATIO: u64 = 255;
/// A run-length block of zstd is four bytes for at most 128 KiB.
const ZSTD_RATIO: u64 = 128 * 1024 / 4;
/// A zstd frame may ask for this window at most, 2^23 bytes, whatever its header says.
const ZSTD_WINDOW_LOG: u32 = 23;

/// What so many bytes may become in any case: one large sample of zeros.
const PLAUSIBLE_BYTES: u64 = 64 << 20;
/// How many times its bytes a chunk may become beyond that.
const PLAUSIBLE_RATIO: u64 = 256;

/// How the records of a block are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Compressed {
    No,
    Lz4,
    Zstd,
}

/// Where records lie in a file: the inside of a chunk, or one record that stands outside any chunk.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Block {
    /// First stored byte in the file.
    pub offset: u64,
    /// Stored bytes that are there.
    pub stored: u64,
    /// Bytes after decompression, as the file says.
    pub size: u64,
    /// Checksum of the decompressed bytes; 0 where there is none.
    pub crc: u32,
    pub compressed: Compressed,
    /// The file ends inside the chunk: there is no checksum to go by.
    pub cut: bool,
}

/// What a block held. The bytes stand in the buffer that it was loaded into.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Loaded {
    /// Every byte.
    Whole,
    /// What came out before the cut.
    Partial,
    /// The bytes are not those that were written; its records cannot be used.
    Damaged(String),
}

/// Why the records of a chunk are not read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("its compression `{}` is not known", .0.escape_debug())]
pub(crate) struct UnknownCompression(String);

impl Block {
    /// The block of a chunk whose records start at `offset`, with `there` bytes of the file from there on.
    pub fn of_chunk(header: &ChunkHeader, offset: u64, there: u64) -> Result<Self, UnknownCompression> {
        let compressed = match header.compression.as_str() {
            "" => Compressed::No,
            "lz4" => Compressed::Lz4,
            "zstd" => Compressed::Zstd,
            other => return Err(UnknownCompression(other.to_owned())),
        };
        Ok(Self {
            offset,
            stored: header.compressed_size.min(there),
            size: header.uncompressed_size,
            crc: header.crc,
            compressed,
            cut: header.compressed_size > there,
        })
    }

    /// One record that stands at `offset` outside any chunk, with a body of `len` bytes.
    pub fn of_record(offset: u64, len: u64) -> Self {
        let size = RECORD_HEADER as u64 + len;
        Self { offset, stored: size, size, crc: 0, compressed: Compressed::No, cut: false }
    }

    /// Largest size that the stored bytes can justify.
    fn limit(&self) -> u64 {
        let ratio = match self.compressed {
            Compressed::No => 1,
            Compressed::Lz4 => LZ4_RATIO,
            Compressed::Zstd => ZSTD_RATIO,
        };
        self.stored.saturating_mul(ratio).min(self.size).min(self.plausible())
    }

    /// Largest size that is taken for no bomb: a small file must not cost the memory of a large one.
    fn plausible(&self) -> u64 {
        self.stored.saturating_mul(PLAUSIBLE_RATIO).clamp(PLAUSIBLE_BYTES, LARGEST_CHUNK)
    }

    /// Reads the block into `bytes`; `stored` is room for what is not decompressed yet. Memory grows with what comes
    /// out, never with what a header promises.
    pub fn load(&self, source: &Source, bytes: &mut Buffer, stored: &mut Buffer) -> io::Result<Loaded> {
        if self.compressed != Compressed::No && !self.cut && self.size > self.plausible() {
            bytes.set_len(0);
            return Ok(Loaded::Damaged(format!(
                "its {} bytes would become {} MiB (allowed: {} MiB)",
                self.stored,
                self.size >> 20,
                self.plausible() >> 20
            )));
        }
        let read = |into: &mut Buffer| {
            source.read_into(self.offset, usize::try_from(self.stored).unwrap_or(usize::MAX), into)
        };
        let fault = match self.compressed {
            Compressed::No => {
                read(bytes)?;
                None
            }
            Compressed::Lz4 => {
                read(stored)?;
                // Of two checksums of the same bytes one is enough.
                if self.crc != 0 {
                    without_checksum(stored);
                }
                match lz4::Decoder::new(&stored[..]) {
                    Ok(decoder) => drain(decoder, self.limit(), bytes),
                    Err(e) => none_of(bytes, &e),
                }
            }
            Compressed::Zstd => {
                read(stored)?;
                match zstd::stream::read::Decoder::with_buffer(&stored[..]) {
                    Ok(mut decoder) => match decoder.window_log_max(ZSTD_WINDOW_LOG) {
                        Ok(()) => drain(decoder, self.limit(), bytes),
                        Err(e) => none_of(bytes, &e),
                    },
                    Err(e) => none_of(bytes, &e),
                }
            }
        };
        if self.cut {
            return Ok(Loaded::Partial);
        }
        if bytes.len() as u64 != self.size {
            let fault = fault.map(|f| format!(": {f}")).unwrap_or_default();
            let (found, size) = (bytes.len(), self.size);
            return Ok(Loaded::Damaged(format!("{found} bytes came out of it where {size} went in{fault}")));
        }
        let crc = if self.crc == 0 { 0 } else { crc32fast::hash(bytes) };
        if crc != self.crc {
            let stored = self.crc;
            return Ok(Loaded::Damaged(format!("its checksum is {crc:08x} where {stored:08x} was stored")));
        }
        Ok(Loaded::Whole)
    }
}

fn none_of(bytes: &mut Buffer, fault: &io::Error) -> Option<String> {
    bytes.set_len(0);
    Some(fault.to_string())
}

/// Puts all that comes out up to `limit` into `bytes`, and gives the fault that ended it.
fn drain(mut from: impl Read, limit: u64, bytes: &mut Buffer) -> Option<String> {
    let limit = usize::try_from(limit).unwrap_or(usize::MAX);
    let mut filled = 0;
    let mut step = 64 * 1024;
    // Room of an earlier use costs nothing, and lets a decoder write in place.
    bytes.set_len(limit.min(bytes.room()));
    let fault = loop {
        if filled == bytes.len() {
            if filled >= limit {
                break None;
            }
            // New room only when the last is used up: a decoder fills a little at a time.
            bytes.set_len(limit.min(filled + step));
            step = (step * 2).min(1 << 20);
        }
        match from.read(&mut bytes[filled..]) {
            Ok(0) => break None,
            Ok(n) => filled += n,
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) => break Some(e.to_string()),
        }
    };
    bytes.set_len(filled);
    fault
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_few_bytes_that_would_become_many_are_refused_before_they_take_memory() {
        for (mib, is_whole) in [(60_u64, true), (100, false)] {
            let stored = zstd::stream::encode_all(io::repeat(0).take(mib << 20), 1).unwrap();
            let length = stored.len() as u64;
            let size = mib << 20;
            let block =
                Block { offset: 0, stored: length, size, crc: 0, compressed: Compressed::Zstd, cut: false };
            let (mut bytes, mut room) = (Buffer::default(), Buffer::default());
            let loaded = block.load(&Source::Bytes(stored.into()), &mut bytes, &mut room).unwrap();
            if is_whole {
                assert_eq!((loaded, bytes.len() as u64), (Loaded::Whole, size));
            } else {
                let refusal = format!("its {length} bytes would become 100 MiB (allowed: 64 MiB)");
                assert_eq!((loaded, bytes.room()), (Loaded::Damaged(refusal), 0));
            }
        }
    }
}
