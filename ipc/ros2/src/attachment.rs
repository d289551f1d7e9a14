//! What stands beside each message: its number, its time, and its sender.

use thiserror::Error;

/// Bytes of an attachment.
pub const SIZE: usize = 33;
/// Bytes of the identity of a sender.
const GID: usize = 16;

/// Why bytes are no attachment.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum AttachmentError {
    /// It has another length.
    #[error("it has {0} bytes where {SIZE} are expected")]
    Size(usize),
    /// The identity has another length.
    #[error("the identity of its sender has {0} bytes where {GID} are expected")]
    Gid(u8),
    /// Its number or its time is negative.
    #[error("its number {sequence} or its time {time} ns is negative")]
    Negative {
        /// Number of the message.
        sequence: i64,
        /// Time of sending, ns.
        time: i64,
    },
}

/// Number, time and sender of a message: 33 bytes, little-endian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Attachment {
    /// Number of the message, which its sender counts from 1.
    pub sequence: u64,
    /// Time of sending, ns since 1970.
    pub time: u64,
    /// Identity of the sender: see [`gid`](crate::gid).
    pub gid: [u8; GID],
}

impl Attachment {
    /// As it goes over the wire. A number or time of 2^63 and more is written as the largest one that fits.
    pub fn to_bytes(self) -> [u8; SIZE] {
        let signed = |n: u64| i64::try_from(n).unwrap_or(i64::MAX).to_le_bytes();
        let mut bytes = [0; SIZE];
        bytes[..8].copy_from_slice(&signed(self.sequence));
        bytes[8..16].copy_from_slice(&signed(self.time));
        bytes[16] = GID as u8;
        bytes[17..].copy_from_slice(&self.gid);
        bytes
    }

    /// Reads one.
    ///
    /// # Errors
    /// What is wrong with the bytes.
    pub fn parse(bytes: &[u8]) -> Result<Self, AttachmentError> {
        let Ok(bytes) = <&[u8; SIZE]>::try_from(bytes) else {
            return Err(AttachmentError::Size(bytes.len()));
        };
        let number = |at: usize| bytes[at..].first_chunk().map_or(0, |b| i64::from_le_bytes(*b));
        if usize::from(bytes[16]) != GID {
            return Err(AttachmentError::Gid(bytes[16]));
        }
        let (sequence, time) = (number(0), number(8));
        let mut gid = [0; GID];
        gid.copy_from_slice(&bytes[17..]);
        match (u64::try_from(sequence), u64::try_from(time)) {
            (Ok(sequence), Ok(time)) => Ok(Self { sequence, time, gid }),
            _ => Err(AttachmentError::Negative { sequence, time }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_bytes_stand_in_the_order_of_the_convention() {
        let gid = std::array::from_fn(|i| i as u8 + 1);
        let bytes = Attachment { sequence: 0x0102, time: 0x0304, gid }.to_bytes();
        assert_eq!(bytes[..9], [2, 1, 0, 0, 0, 0, 0, 0, 4]);
        assert_eq!((bytes[16], &bytes[17..20]), (16, &[1, 2, 3][..]));
    }

    #[test]
    fn broken_ones_are_refused_with_numbers() {
        let good = Attachment { sequence: 1, time: 2, gid: [3; 16] }.to_bytes();
        assert_eq!(Attachment::parse(&good[..32]), Err(AttachmentError::Size(32)));
        let mut broken = good;
        broken[16] = 24;
        assert_eq!(Attachment::parse(&broken), Err(AttachmentError::Gid(24)));
        let mut broken = good;
        broken[..8].fill(0xff);
        assert_eq!(Attachment::parse(&broken), Err(AttachmentError::Negative { sequence: -1, time: 2 }));
    }

    proptest! {
        #[test]
        fn what_is_written_is_read_and_any_bytes_are_read_or_refused(
            sequence in 0..=i64::MAX as u64,
            time in 0..=i64::MAX as u64,
            gid in any::<[u8; 16]>(),
            bytes in prop::collection::vec(any::<u8>(), 30..36),
        ) {
            let attachment = Attachment { sequence, time, gid };
            prop_assert_eq!(Attachment::parse(&attachment.to_bytes()), Ok(attachment));
            if let Ok(read) = Attachment::parse(&bytes) {
                prop_assert_eq!(&read.to_bytes()[..], &bytes[..]);
            }
        }
    }
}
