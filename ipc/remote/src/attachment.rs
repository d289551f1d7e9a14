//! What precedes the body of a sample on the wire.

use stillpoint_samples::{HEADER_SIZE, Header};
use zerocopy::{FromBytes, IntoBytes};

/// The attachment of a publication: the header of the sample, the sending end, and the number of the sample at that end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Attachment {
    /// Header of the sample.
    pub header: Header,
    /// The sending end.
    pub end: u64,
    /// Number of the sample at this end, from 1.
    pub number: u64,
}

impl Attachment {
    /// Bytes of an attachment.
    pub const SIZE: usize = HEADER_SIZE + 16;

    /// The bytes on the wire, little-endian.
    pub fn to_bytes(&self) -> [u8; Self::SIZE] {
        let mut bytes = [0; Self::SIZE];
        bytes[..HEADER_SIZE].copy_from_slice(self.header.as_bytes());
        bytes[HEADER_SIZE..HEADER_SIZE + 8].copy_from_slice(&self.end.to_le_bytes());
        bytes[HEADER_SIZE + 8..].copy_from_slice(&self.number.to_le_bytes());
        bytes
    }

    /// Reads an attachment; `None` if the length is wrong or the number is 0.
    pub fn read(bytes: &[u8]) -> Option<Self> {
        let (header, rest) = bytes.split_at_checked(HEADER_SIZE)?;
        let header = Header::read_from_bytes(header).ok()?;
        let (end, number) = rest.split_at_checked(8)?;
        let (end, number) =
            (u64::from_le_bytes(end.try_into().ok()?), u64::from_le_bytes(number.try_into().ok()?));
        (number > 0).then_some(Self { header, end, number })
    }
}
