//! Messages of ROS 2 in CDR: numbers and texts, each at a multiple of its size from behind the 4-byte encapsulation.
//!
//! The recorder and the operators that read recordings of others share this reader, so that damage means one thing: a
//! message that one of them refuses, the other refuses, too.
//!
//! ```
//! use stillpoint_cdr::{Reader, Writer};
//! let mut message = Vec::new();
//! let mut w = Writer::new(&mut message);
//! w.header(1_500_000_000, "camera");
//! w.u8(3);
//! w.f64s(&[0.5]);
//! let mut r = Reader::new(&message)?;
//! assert_eq!((r.header()?, r.u8()?, r.f64()?, r.rest()), (1_500_000_000, 3, 0.5, 0));
//! # Ok::<(), stillpoint_cdr::CdrError>(())
//! ```

mod reader;
pub mod schema;
mod writer;

use thiserror::Error;

pub use reader::Reader;
pub use writer::Writer;

/// The first bytes of a message in XCDR1, little-endian: the one form that is written.
pub const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

const NANOSECONDS: u64 = 1_000_000_000;

/// Whether a stamp in ns has a place in ROS time, whose seconds are 31 bits.
pub fn is_ros_time(stamp: u64) -> bool {
    stamp / NANOSECONDS <= i32::MAX as u64
}

/// Why bytes are not the message that they should be. Offsets are in bytes from the start of the message.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum CdrError {
    /// The bytes are too few for any message.
    #[error("{0} bytes are not a CDR message: 4 bytes that name its form come first")]
    NoMessage(usize),
    /// The bytes are in another form.
    #[error("it starts with {found:02x?}, which does not mark {expected}{}", hint(*found))]
    Encapsulation {
        /// The first bytes.
        found: [u8; 4],
        /// The form that is read.
        expected: &'static str,
    },
    /// The message ends too early.
    #[error("it ends at byte {found}, and its field at byte {at} needs {needed} bytes")]
    TooShort {
        /// Offset of the field.
        at: usize,
        /// Bytes of the field.
        needed: usize,
        /// Bytes of the message.
        found: usize,
    },
    /// A text is not UTF-8.
    #[error("its text at byte {0} is not UTF-8")]
    Text(usize),
    /// A stamp is not a time.
    #[error("its stamp of {seconds} s and {nanoseconds} ns is not a time")]
    Stamp {
        /// Seconds.
        seconds: i32,
        /// Nanoseconds within the second.
        nanoseconds: u32,
    },
}

/// What the first bytes of a message that is not CDR mark instead.
fn hint(found: [u8; 4]) -> &'static str {
    match found {
        [0x28, 0xb5, 0x2f, 0xfd] => {
            ": the recorder compressed each message by zstd: convert the bag with `ros2 bag convert`"
        }
        _ => "",
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn message() -> Vec<u8> {
        let mut out = Vec::new();
        let mut w = Writer::new(&mut out);
        w.header(3_000_000_007, "a");
        w.u32(9);
        w.u8(1);
        w.u64(u64::MAX);
        w.bytes(&[5, 6]);
        out
    }

    #[test]
    fn what_is_written_is_read() {
        let message = message();
        for reader in [Reader::new(&message), Reader::in_either_order(&message)] {
            let mut r = reader.unwrap();
            assert_eq!((r.header().unwrap(), r.u32().unwrap(), r.u8().unwrap()), (3_000_000_007, 9, 1));
            assert_eq!((r.u64().unwrap(), r.bytes().unwrap(), r.rest()), (u64::MAX, &[5, 6][..], 0));
        }
    }

    #[test]
    fn the_other_byte_order_is_read_where_others_write_it() {
        let message = [&[0, 0, 0, 0][..], &7_u32.to_be_bytes(), &[0; 4], &0.25_f64.to_be_bytes()].concat();
        let mut r = Reader::in_either_order(&message).unwrap();
        assert_eq!((r.u32().unwrap(), r.f64().unwrap()), (7, 0.25));
        let refused = Reader::new(&message).unwrap_err();
        assert_eq!(
            refused.to_string(),
            "it starts with [00, 00, 00, 00], which does not mark little-endian CDR"
        );
    }

    #[test]
    fn damage_is_refused_with_its_place() {
        let message = message();
        assert_eq!(Reader::new(&message[..3]).unwrap_err(), CdrError::NoMessage(3));
        let mut r = Reader::new(&message[..10]).unwrap();
        assert_eq!(r.header().unwrap_err(), CdrError::TooShort { at: 8, needed: 4, found: 10 });
        let mut late = message.clone();
        late[8..12].copy_from_slice(&1_000_000_000_u32.to_le_bytes());
        let error = Reader::new(&late).unwrap().header().unwrap_err();
        assert_eq!(error, CdrError::Stamp { seconds: 3, nanoseconds: 1_000_000_000 });
        let mut text = message.clone();
        text[16] = 0xff;
        assert_eq!(Reader::new(&text).unwrap().header().unwrap_err(), CdrError::Text(16));
    }

    proptest! {
        #[test]
        fn any_bytes_are_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..40), order in 0_u8..2) {
            let message = [&[0, order, 0, 0][..], &bytes].concat();
            let mut r = Reader::in_either_order(&message).unwrap();
            while r.header().is_ok() && r.bytes().is_ok() {
                prop_assert!(r.rest() <= bytes.len());
            }
        }
    }
}
