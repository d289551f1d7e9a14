//! Decompression that a hostile file cannot make large: a reader says how much it expects, and no more is made.

use std::io::{ErrorKind, Read};

use thiserror::Error;

/// What deflate can make of one byte at most (zlib's technical notes: 1032 to 1).
const LARGEST_RATIO: usize = 1032;

/// Why compressed bytes are not what they should be.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum InflateError {
    /// There are fewer bytes than expected.
    #[error("the compressed data end early: {expected} bytes are expected")]
    Short {
        /// Bytes that were due.
        expected: usize,
    },
    /// There are more bytes than expected.
    #[error("the compressed data go on beyond the {expected} bytes that are expected")]
    Long {
        /// Bytes that were due.
        expected: usize,
    },
    /// The bytes are no compressed data, or their checksum is wrong.
    #[error("the compressed data are damaged")]
    Damaged,
}

/// All bytes of a decoder over `compressed` bytes, which must be `expected`.
pub fn inflate(mut decoder: impl Read, compressed: usize, expected: usize) -> Result<Vec<u8>, InflateError> {
    let fault = |error: std::io::Error| match error.kind() {
        ErrorKind::UnexpectedEof => InflateError::Short { expected },
        _ => InflateError::Damaged,
    };
    if expected / LARGEST_RATIO > compressed {
        return Err(InflateError::Short { expected });
    }
    let mut bytes = Vec::with_capacity(expected);
    decoder.by_ref().take(expected as u64).read_to_end(&mut bytes).map_err(fault)?;
    if bytes.len() < expected {
        return Err(InflateError::Short { expected });
    }
    // Reading on also makes the decoder compare its checksum.
    match decoder.read(&mut [0]).map_err(fault)? {
        0 => Ok(bytes),
        _ => Err(InflateError::Long { expected }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::{Compression, read::ZlibDecoder, write::ZlibEncoder};
    use std::io::Write;

    fn packed(bytes: &[u8]) -> Vec<u8> {
        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::best());
        encoder.write_all(bytes).unwrap();
        encoder.finish().unwrap()
    }

    #[test]
    fn exactly_what_is_due_comes_out_or_it_is_said_why_not() {
        let raw = vec![7; 1_000_000];
        let small = packed(&raw);
        let of = |bytes: &[u8], expected| inflate(ZlibDecoder::new(bytes), bytes.len(), expected);
        assert_eq!(of(&small, raw.len()).unwrap(), raw);
        assert_eq!(of(&small, raw.len() + 1), Err(InflateError::Short { expected: raw.len() + 1 }));
        assert_eq!(of(&small, raw.len() - 1), Err(InflateError::Long { expected: raw.len() - 1 }));
        assert_eq!(
            of(&small[..small.len() / 2], raw.len()),
            Err(InflateError::Short { expected: raw.len() })
        );
        let mut broken = small.clone();
        *broken.last_mut().unwrap() ^= 1;
        assert_eq!(of(&broken, raw.len()), Err(InflateError::Damaged));
    }

    #[test]
    fn more_than_deflate_can_hold_is_refused_before_memory_is_taken() {
        let tiny = packed(b"x");
        assert!(inflate(ZlibDecoder::new(&tiny[..]), tiny.len(), usize::MAX / 4).is_err());
    }
}
