//! Canonical bytes: a mark with the version of the format, then the value in postcard (version 1 of its wire format): lists and
//! texts behind their length, whole numbers as variable-length integers, floats by their bits.
//!
//! A reader checks the length before it reads, makes nothing before its bytes are there, and takes no other bytes than a
//! writer makes, so that one value has one hash.

use serde::Serialize;
use serde::de::DeserializeOwned;
use thiserror::Error;

/// Why bytes cannot be read.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum WireError {
    /// A length or a number is beyond its bound.
    #[error("{what} is {found}; at most {most} is allowed")]
    Bound {
        /// What it is.
        what: &'static str,
        /// Its value.
        found: u64,
        /// The most.
        most: u64,
    },
    /// They do not begin with the mark of their format.
    #[error("the bytes are not {0} of this version")]
    Version(&'static str),
    /// They are broken.
    #[error("the bytes of {what} are broken: {why}")]
    Broken {
        /// What they should be.
        what: &'static str,
        /// Why they are not.
        why: postcard::Error,
    },
    /// There are bytes behind the end.
    #[error("there are {0} bytes behind the end")]
    Trailing(usize),
    /// The same value has other bytes.
    #[error("the bytes of {0} are not its canonical ones")]
    NotCanonical(&'static str),
    /// A value is not allowed.
    #[error("{0} is not allowed")]
    Value(&'static str),
}

/// A format of bytes.
pub struct Format {
    /// What it holds.
    pub what: &'static str,
    /// Its first bytes; another version has another mark.
    pub mark: &'static [u8],
    /// Its longest bytes.
    pub most: usize,
}

impl Format {
    /// The bytes of a value. All types of this crate have lists of known length, so that no value fails to be written; the
    /// mark alone would be refused by every reader.
    pub fn write<T: Serialize + ?Sized>(&self, value: &T) -> Vec<u8> {
        postcard::to_extend(value, self.mark.to_vec()).unwrap_or_else(|_| self.mark.to_vec())
    }

    /// The value of bytes that anybody may have made.
    pub fn read<T: Serialize + DeserializeOwned>(&self, bytes: &[u8]) -> Result<T, WireError> {
        let value = self.head(bytes)?;
        match self.write(&value) == bytes {
            true => Ok(value),
            false => Err(WireError::NotCanonical(self.what)),
        }
    }

    /// The same where the bytes are long: what stands first, which says how much follows, is checked before the rest is read.
    pub fn read_after<H: DeserializeOwned, T: Serialize + DeserializeOwned>(
        &self,
        bytes: &[u8],
        check: impl FnOnce(H) -> Result<(), WireError>,
    ) -> Result<T, WireError> {
        let (head, _) = postcard::take_from_bytes(self.behind_mark(bytes)?).map_err(self.broken())?;
        check(head)?;
        self.read(bytes)
    }

    fn head<T: DeserializeOwned>(&self, bytes: &[u8]) -> Result<T, WireError> {
        let (value, rest) = postcard::take_from_bytes(self.behind_mark(bytes)?).map_err(self.broken())?;
        if rest.is_empty() { Ok(value) } else { Err(WireError::Trailing(rest.len())) }
    }

    fn behind_mark<'a>(&self, bytes: &'a [u8]) -> Result<&'a [u8], WireError> {
        at_most(bytes.len(), self.most, "the length of the bytes")?;
        bytes.strip_prefix(self.mark).ok_or(WireError::Version(self.what))
    }

    fn broken(&self) -> impl Fn(postcard::Error) -> WireError {
        let what = self.what;
        move |why| WireError::Broken { what, why }
    }
}

/// Refuses a number beyond its bound.
pub fn at_most(found: usize, most: usize, what: &'static str) -> Result<(), WireError> {
    let bound = WireError::Bound { what, found: found as u64, most: most as u64 };
    if found <= most { Ok(()) } else { Err(bound) }
}

/// Bytes as one piece, not as a list of numbers.
pub mod bytes {
    use std::fmt;

    use serde::de::{Error, Visitor};
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(bytes: &[u8], to: S) -> Result<S::Ok, S::Error> {
        to.serialize_bytes(bytes)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<u8>, D::Error> {
        Piece::deserialize(from).map(|piece| piece.0)
    }

    /// Bytes that serde takes as one piece.
    struct Piece(Vec<u8>);

    impl<'de> Deserialize<'de> for Piece {
        fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
            struct Bytes;
            impl Visitor<'_> for Bytes {
                type Value = Piece;

                fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                    f.write_str("bytes")
                }

                fn visit_bytes<E: Error>(self, bytes: &[u8]) -> Result<Piece, E> {
                    Ok(Piece(bytes.to_vec()))
                }
            }
            from.deserialize_bytes(Bytes)
        }
    }

    /// Bytes behind their CRC-32.
    pub mod checked {
        use super::{Deserialize, Deserializer, Error, Piece, Serialize, Serializer};

        struct Borrowed<'a>(&'a [u8]);

        impl Serialize for Borrowed<'_> {
            fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
                to.serialize_bytes(self.0)
            }
        }

        pub fn serialize<S: Serializer>(bytes: &[u8], to: S) -> Result<S::Ok, S::Error> {
            (crc32fast::hash(bytes), Borrowed(bytes)).serialize(to)
        }

        pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<u8>, D::Error> {
            let (checksum, Piece(bytes)) = <(u32, Piece)>::deserialize(from)?;
            match crc32fast::hash(&bytes) == checksum {
                true => Ok(bytes),
                false => Err(D::Error::custom("a content without its checksum")),
            }
        }
    }
}
