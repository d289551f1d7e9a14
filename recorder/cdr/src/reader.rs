//! Reads messages.

use crate::{CdrError, ENCAPSULATION, NANOSECONDS};

/// Reads a CDR message.
#[derive(Debug, Clone)]
pub struct Reader<'a> {
    body: &'a [u8],
    at: usize,
    big_endian: bool,
}

impl<'a> Reader<'a> {
    /// Starts behind the encapsulation of a message that [`Writer`](crate::Writer) wrote: little-endian, and no other.
    ///
    /// # Errors
    /// Another encapsulation.
    pub fn new(data: &'a [u8]) -> Result<Self, CdrError> {
        match Self::split(data)? {
            (ENCAPSULATION, body) => Ok(Self { body, at: 0, big_endian: false }),
            (found, _) => Err(CdrError::Encapsulation { found, expected: "little-endian CDR" }),
        }
    }

    /// Starts behind the encapsulation of a message of another program: plain CDR in either byte order.
    ///
    /// # Errors
    /// Another encapsulation.
    pub fn in_either_order(data: &'a [u8]) -> Result<Self, CdrError> {
        match Self::split(data)? {
            // The last two bytes are options, which plain CDR does not use.
            ([0, order @ (0 | 1), ..], body) => Ok(Self { body, at: 0, big_endian: order == 0 }),
            (found, _) => Err(CdrError::Encapsulation { found, expected: "plain CDR (00 00 or 00 01)" }),
        }
    }

    fn split(data: &'a [u8]) -> Result<([u8; 4], &'a [u8]), CdrError> {
        let (first, body) = data.split_first_chunk().ok_or(CdrError::NoMessage(data.len()))?;
        Ok((*first, body))
    }

    /// `n` bytes at a multiple of `align`.
    ///
    /// # Errors
    /// The message ends before.
    pub fn raw(&mut self, n: usize, align: usize) -> Result<&'a [u8], CdrError> {
        let start = self.at.next_multiple_of(align);
        let end = start.checked_add(n).filter(|end| *end <= self.body.len());
        let end = end.ok_or_else(|| CdrError::TooShort {
            at: start + ENCAPSULATION.len(),
            needed: n,
            found: self.body.len() + ENCAPSULATION.len(),
        })?;
        self.at = end;
        Ok(&self.body[start..end])
    }

    /// Bytes that were not read.
    pub fn rest(&self) -> usize {
        self.body.len() - self.at
    }

    /// The bytes of a number, the least first.
    fn array<const N: usize>(&mut self) -> Result<[u8; N], CdrError> {
        let mut bytes = [0; N];
        bytes.copy_from_slice(self.raw(N, N)?);
        if self.big_endian {
            bytes.reverse();
        }
        Ok(bytes)
    }

    /// A whole number of 8 bits.
    ///
    /// # Errors
    /// The message ends before.
    pub fn u8(&mut self) -> Result<u8, CdrError> {
        Ok(u8::from_le_bytes(self.array()?))
    }

    /// A whole number of 32 bits.
    ///
    /// # Errors
    /// The message ends before.
    pub fn u32(&mut self) -> Result<u32, CdrError> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    /// A whole number of 64 bits.
    ///
    /// # Errors
    /// The message ends before.
    pub fn u64(&mut self) -> Result<u64, CdrError> {
        Ok(u64::from_le_bytes(self.array()?))
    }

    /// A float of 64 bits.
    ///
    /// # Errors
    /// The message ends before.
    pub fn f64(&mut self) -> Result<f64, CdrError> {
        Ok(f64::from_bits(self.u64()?))
    }

    /// A text, without its closing zero.
    ///
    /// # Errors
    /// The message ends before, or the text is not UTF-8.
    pub fn text(&mut self) -> Result<&'a str, CdrError> {
        let bytes = self.bytes()?;
        let at = self.at - bytes.len() + ENCAPSULATION.len();
        let bytes = bytes.strip_suffix(&[0]).unwrap_or(bytes);
        std::str::from_utf8(bytes).map_err(|_| CdrError::Text(at))
    }

    /// A sequence of bytes.
    ///
    /// # Errors
    /// The message ends before.
    pub fn bytes(&mut self) -> Result<&'a [u8], CdrError> {
        let length = self.u32()? as usize;
        self.raw(length, 1)
    }

    /// Stamp in ns of a `std_msgs/Header`.
    ///
    /// # Errors
    /// The message ends before, its frame is not UTF-8, or its stamp is no time.
    pub fn header(&mut self) -> Result<u64, CdrError> {
        self.header_and_frame().map(|(stamp, _)| stamp)
    }

    /// Stamp in ns, and frame, of a `std_msgs/Header`.
    ///
    /// # Errors
    /// As of [`header`](Self::header).
    pub fn header_and_frame(&mut self) -> Result<(u64, &'a str), CdrError> {
        let (seconds, nanoseconds, frame) = self.stamp_parts()?;
        let whole = u64::try_from(seconds).map_err(|_| CdrError::Stamp { seconds, nanoseconds })?;
        Ok((whole * NANOSECONDS + u64::from(nanoseconds), frame))
    }

    /// Stamp in ns, and frame, of a `std_msgs/Header` of another program. A stamp of zero, and one before it, with which
    /// some drivers mark a missing time, are `None`.
    ///
    /// # Errors
    /// The message ends before, its frame is not UTF-8, or its nanoseconds are more than a second.
    pub fn foreign_header(&mut self) -> Result<(Option<u64>, &'a str), CdrError> {
        let (seconds, nanoseconds, frame) = self.stamp_parts()?;
        let whole = u64::try_from(seconds).ok().map(|s| s * NANOSECONDS + u64::from(nanoseconds));
        Ok((whole.filter(|stamp| *stamp > 0), frame))
    }

    fn stamp_parts(&mut self) -> Result<(i32, u32, &'a str), CdrError> {
        let (seconds, nanoseconds) = (self.u32()?.cast_signed(), self.u32()?);
        let frame = self.text()?;
        if u64::from(nanoseconds) >= NANOSECONDS {
            return Err(CdrError::Stamp { seconds, nanoseconds });
        }
        Ok((seconds, nanoseconds, frame))
    }
}
