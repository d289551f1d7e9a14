//! The identifiers that a case keeps: they name studies and images, not people.

use std::fmt;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use thiserror::Error;

/// A DICOM unique identifier: numbers joined by dots, at most 64 characters. Zeros that lead a number are against the
/// standard but written by many programs, and kept.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Uid(String);

/// Why a text is no UID.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("{text:?} is not a UID: it must be numbers joined by dots, at most 64 characters")]
pub struct UidError {
    text: String,
}

impl Uid {
    /// The UID that this text is; spaces and the NUL that pads it to even length are cut off.
    pub fn parse(text: &str) -> Result<Self, UidError> {
        let trimmed = text.trim_end_matches(['\0', ' ']);
        let number = |part: &str| !part.is_empty() && part.bytes().all(|b| b.is_ascii_digit());
        if trimmed.len() <= 64 && trimmed.split('.').count() > 1 && trimmed.split('.').all(number) {
            return Ok(Self(trimmed.to_owned()));
        }
        Err(UidError { text: text.chars().take(80).collect() })
    }

    /// A UID made of what it names: `2.25.` and the number of a version 8 UUID (RFC 9562) from the SHA-256 of `kind` and
    /// `content`. The same content has the same UID on every machine.
    pub fn of_content(kind: &str, content: &[u8]) -> Self {
        let mut hasher = Sha256::new();
        hasher.update((kind.len() as u64).to_le_bytes());
        hasher.update(kind);
        hasher.update(content);
        let mut number = [0; 16];
        number.copy_from_slice(&hasher.finalize()[..16]);
        number[6] = number[6] & 0x0f | 0x80;
        number[8] = number[8] & 0x3f | 0x80;
        Self(format!("2.25.{}", u128::from_be_bytes(number)))
    }

    /// Its text.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for Uid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl TryFrom<String> for Uid {
    type Error = UidError;
    fn try_from(text: String) -> Result<Self, UidError> {
        Self::parse(&text)
    }
}

impl From<Uid> for String {
    fn from(uid: Uid) -> Self {
        uid.0
    }
}

/// Where a case comes from, in identifiers.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Uids {
    /// The study of the images.
    pub study: Uid,
    /// The series of the images.
    pub series: Uid,
    /// The frame of reference that positions are given in.
    pub frame_of_reference: Uid,
    /// The structure set.
    pub structure_set: Uid,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_uid_is_numbers_joined_by_dots() {
        assert_eq!(Uid::parse("1.2.840.0\0").unwrap().as_str(), "1.2.840.0");
        for bad in ["", "1", "1..2", ".1.2", "1.2.", "1.2a", "DOE^JOHN", &"1.2".repeat(30)] {
            assert!(Uid::parse(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn a_uid_of_content_is_a_uuid_and_depends_on_kind_and_content() {
        let uid = Uid::of_content("plan", b"abc");
        assert_eq!(Uid::parse(uid.as_str()).unwrap(), uid);
        let number: u128 = uid.as_str()["2.25.".len()..].parse().unwrap();
        assert_eq!((number >> 76 & 0xf, number >> 62 & 0b11), (8, 0b10), "version and variant of the UUID");
        assert_ne!(uid, Uid::of_content("dose", b"abc"));
        assert_ne!(uid, Uid::of_content("plan", b"abd"));
        assert_ne!(Uid::of_content("ab", b"c"), Uid::of_content("a", b"bc"));
    }
}
