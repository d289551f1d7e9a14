//! What orders and acknowledgements share: the form of their datagrams, and the code at the end.

use crate::key::{Key, MAC_SIZE};
use crate::refusal::DatagramRefusal;

/// The form of a kind of datagram: a magic number, a version, a header, up to `most` numbers (`f32`, little-endian), and
/// the HMAC-SHA-256 of all bytes before it.
pub(crate) struct Form {
    /// The first four bytes.
    pub magic: [u8; 4],
    pub version: u8,
    /// Bytes before the numbers.
    pub header: usize,
    /// Place of the byte of the header that holds how many numbers follow.
    pub count: usize,
    pub most: usize,
}

impl Form {
    /// Adds magic number, version, numbers and code to a header in `bytes`; gives the length of all.
    pub fn seal(&self, numbers: &[f32], key: &Key, bytes: &mut [u8]) -> usize {
        bytes[..4].copy_from_slice(&self.magic);
        bytes[4] = self.version;
        bytes[self.count] = numbers.len() as u8;
        for (slot, number) in bytes[self.header..].chunks_exact_mut(4).zip(numbers) {
            slot.copy_from_slice(&number.to_le_bytes());
        }
        let end = self.header + 4 * numbers.len();
        let code = key.code(&bytes[..end]);
        bytes[end..end + MAC_SIZE].copy_from_slice(&code);
        end + MAC_SIZE
    }

    /// The bytes before the code, if form and code are right.
    ///
    /// # Errors
    /// Why the datagram is refused.
    pub fn open<'a>(&self, bytes: &'a [u8], key: &Key) -> Result<&'a [u8], DatagramRefusal> {
        let shortest = self.header + MAC_SIZE;
        if bytes.len() < shortest {
            return Err(DatagramRefusal::TooShort);
        }
        if bytes.len() > shortest + 4 * self.most {
            return Err(DatagramRefusal::TooLong);
        }
        if bytes[..4] != self.magic {
            return Err(DatagramRefusal::Foreign);
        }
        if bytes[4] != self.version {
            return Err(DatagramRefusal::Version);
        }
        let count = usize::from(bytes[self.count]);
        if count > self.most || bytes.len() != shortest + 4 * count {
            return Err(DatagramRefusal::Length);
        }
        let (content, code) = bytes.split_at(bytes.len() - MAC_SIZE);
        if key.confirms(content, code) { Ok(content) } else { Err(DatagramRefusal::Forged) }
    }

    /// The numbers of what [`open`](Self::open) gave, and how many they are; zero beyond them.
    pub fn numbers<const N: usize>(&self, content: &[u8]) -> ([f32; N], usize) {
        let mut numbers = [0.0; N];
        for (slot, bytes) in numbers.iter_mut().zip(content[self.header..].chunks_exact(4)) {
            *slot = f32::from_le_bytes(four(bytes));
        }
        (numbers, (content.len() - self.header) / 4)
    }
}

/// The first four bytes, with zeros for those that are missing.
pub(crate) fn four(bytes: &[u8]) -> [u8; 4] {
    std::array::from_fn(|i| bytes.get(i).copied().unwrap_or(0))
}

/// The first eight bytes as a number, with zeros for those that are missing.
pub(crate) fn eight(bytes: &[u8]) -> u64 {
    u64::from_le_bytes(std::array::from_fn(|i| bytes.get(i).copied().unwrap_or(0)))
}
