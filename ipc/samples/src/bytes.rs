//! Samples as bytes: an aligned buffer, and the typed view of one.

use std::marker::PhantomData;

use zerocopy::{FromBytes, IntoBytes};

use crate::kind::{Sample, SampleKind, Shape};
use crate::{HEADER_SIZE, Header};

/// Why bytes are not a sample of a kind.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum BytesError {
    /// Fewer bytes than header and body take.
    Short {
        /// Name of the sample type.
        kind: &'static str,
        /// Bytes that are there.
        found: usize,
        /// Bytes that header and body take.
        needed: usize,
    },
    /// The byte count does not fit the element count that the header states.
    Count {
        /// Name of the sample type.
        kind: &'static str,
        /// Elements that the header states.
        count: u32,
        /// Bytes of elements that are there.
        found: usize,
        /// Bytes of elements that `count` takes (`None` where it overflows).
        needed: Option<usize>,
    },
    /// Header and body state different lengths.
    Length {
        /// Name of the sample type.
        kind: &'static str,
        /// Elements that the header states.
        count: u32,
        /// Elements that the body states.
        length: u32,
    },
    /// The bytes do not start at a multiple of 8.
    Unaligned {
        /// Name of the sample type.
        kind: &'static str,
    },
}

impl std::fmt::Display for BytesError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Short { kind, found, needed } => {
                write!(f, "a {kind} needs at least {needed} bytes for its header, found {found}")
            }
            Self::Count { kind, count, found, needed: Some(needed) } => {
                write!(f, "a {kind} of {count} elements needs {needed} bytes of elements, found {found}")
            }
            Self::Count { kind, count, .. } => write!(f, "a {kind} cannot have {count} elements"),
            Self::Length { kind, count, length } => {
                write!(f, "a {kind} states {count} elements in its header and {length} in its body")
            }
            Self::Unaligned { kind } => write!(f, "the bytes of a {kind} must start at a multiple of 8"),
        }
    }
}

impl std::error::Error for BytesError {}

/// Bytes that start at a multiple of 8, so that any sample can be read in place.
#[derive(Clone, Default)]
pub struct AlignedBytes {
    words: Vec<u64>,
    len: usize,
}

impl AlignedBytes {
    /// `len` zero bytes.
    pub fn zeroed(len: usize) -> Self {
        Self { words: vec![0; len.div_ceil(8)], len }
    }

    /// A copy of `bytes`.
    pub fn copy_of(bytes: &[u8]) -> Self {
        Self::joined(bytes, &[])
    }

    /// A copy of two pieces, one behind the other. The first must be a multiple of 8 long for the second to be aligned.
    pub fn joined(first: &[u8], second: &[u8]) -> Self {
        let len = first.len() + second.len();
        let mut words = Vec::with_capacity(len.div_ceil(8));
        let (whole, odd) = first.as_chunks();
        words.extend(whole.iter().map(|w| u64::from_ne_bytes(*w)));
        // The word that both pieces share, then whole words again: each byte is written once.
        let (shared, rest) = second.split_at(second.len().min((8 - odd.len()) % 8));
        let word = |bytes: &[u8]| {
            let mut word = [0; 8];
            word[..bytes.len()].copy_from_slice(bytes);
            u64::from_ne_bytes(word)
        };
        if !odd.is_empty() {
            words.push(word(&[odd, shared].concat()));
        }
        let (whole, last) = rest.as_chunks();
        words.extend(whole.iter().map(|w| u64::from_ne_bytes(*w)));
        if !last.is_empty() {
            words.push(word(last));
        }
        Self { words, len }
    }

    /// Sets the length; new bytes are zero, kept capacity is reused.
    pub fn resize(&mut self, len: usize) {
        self.words.resize(len.div_ceil(8), 0);
        self.len = len;
    }
}

impl PartialEq for AlignedBytes {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

impl Eq for AlignedBytes {}

impl std::ops::Deref for AlignedBytes {
    type Target = [u8];
    fn deref(&self) -> &[u8] {
        &self.words.as_bytes()[..self.len]
    }
}

impl std::ops::DerefMut for AlignedBytes {
    fn deref_mut(&mut self) -> &mut [u8] {
        &mut self.words.as_mut_bytes()[..self.len]
    }
}

impl std::fmt::Debug for AlignedBytes {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "AlignedBytes({} bytes)", self.len)
    }
}

/// A sample in two pieces, as shared memory holds it: header and body, then the elements.
#[derive(Clone, Copy)]
pub struct Pieces<'a> {
    /// Header and body.
    pub meta: &'a [u8],
    /// The elements; bytes beyond the header's count are not part of the sample.
    pub payload: &'a [u8],
}

impl<'a> Pieces<'a> {
    /// Splits contiguous bytes (`Header ++ Body ++ elements`) and checks every length.
    pub fn split(kind: &SampleKind, bytes: &'a [u8]) -> Result<Self, BytesError> {
        let needed = kind.meta_size();
        if bytes.len() < needed {
            return Err(BytesError::Short { kind: kind.name, found: bytes.len(), needed });
        }
        let (meta, payload) = bytes.split_at(needed);
        let pieces = Self { meta, payload };
        pieces.check(kind)?;
        let exact = pieces.header().count as usize * kind.element_size;
        if payload.len() != exact {
            return Err(BytesError::Count {
                kind: kind.name,
                count: pieces.header().count,
                found: payload.len(),
                needed: Some(exact),
            });
        }
        Ok(pieces)
    }

    /// Checks lengths against what the header states, and cuts the payload to the stated count.
    pub fn check(&self, kind: &SampleKind) -> Result<Pieces<'a>, BytesError> {
        if self.meta.len() != kind.meta_size() {
            return Err(BytesError::Short {
                kind: kind.name,
                found: self.meta.len(),
                needed: kind.meta_size(),
            });
        }
        let count = self.header().count;
        let needed = (count as usize).checked_mul(kind.element_size);
        let bytes = match needed {
            Some(n) if n <= self.payload.len() && (kind.shape == Shape::Slice || count == 1) => n,
            _ => return Err(BytesError::Count { kind: kind.name, count, found: self.payload.len(), needed }),
        };
        if kind.body_size > 0 {
            let length = self.meta[kind.meta_size() - 4..].try_into().map(u32::from_le_bytes).unwrap_or(0);
            if length != count {
                return Err(BytesError::Length { kind: kind.name, count, length });
            }
        }
        Ok(Pieces { meta: self.meta, payload: &self.payload[..bytes] })
    }

    /// The header. A meta piece shorter than a header reads as zeros.
    pub fn header(&self) -> Header {
        self.meta.get(..HEADER_SIZE).and_then(|b| Header::read_from_bytes(b).ok()).unwrap_or_default()
    }

    /// The typed view.
    pub fn view<S: Sample>(&self) -> Result<View<'a, S>, BytesError> {
        let cut = self.check(S::KIND)?;
        let unaligned = || BytesError::Unaligned { kind: S::NAME };
        let body = S::Body::ref_from_bytes(&cut.meta[HEADER_SIZE..]).map_err(|_| unaligned())?;
        let elements = <[S::Element]>::ref_from_bytes(cut.payload).map_err(|_| unaligned())?;
        Ok(View { header: self.header(), body, elements, sample: PhantomData })
    }
}

/// A sample as its type, read in place; only the header is copied.
pub struct View<'a, S: Sample> {
    /// Stamps, sequence, incarnation and count.
    pub header: Header,
    /// The body.
    pub body: &'a S::Body,
    /// What is repeated: `header.count` of them.
    pub elements: &'a [S::Element],
    sample: PhantomData<S>,
}

impl<'a, S: Sample> View<'a, S> {
    /// The one element of a fixed sample; the first of a slice, if it has any.
    pub fn first(&self) -> Option<&'a S::Element> {
        self.elements.first()
    }
}

#[cfg(test)]
mod tests {
    use super::AlignedBytes;

    #[test]
    fn two_pieces_are_joined_at_any_length() {
        let bytes: Vec<u8> = (1..=60).collect();
        for len in 0..=bytes.len() {
            for at in 0..=len {
                let joined = AlignedBytes::joined(&bytes[..at], &bytes[at..len]);
                assert_eq!(*joined, bytes[..len], "{at} of {len}");
                assert_eq!(joined.words.len(), len.div_ceil(8), "{at} of {len}");
            }
        }
    }

    #[test]
    fn bytes_beyond_the_length_do_not_count() {
        let mut cut = AlignedBytes::copy_of(&[7; 16]);
        cut.resize(11);
        assert_eq!(cut, AlignedBytes::copy_of(&[7; 11]));
    }
}
