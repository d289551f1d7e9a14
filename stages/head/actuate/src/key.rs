//! The key that sender and far end share, and the file that holds it.
//!
//! A key file is text: 64 hexadecimal digits, which may be broken into lines; lines that begin with `#` are remarks.
//! `openssl rand -hex 32 > rig.key && chmod 600 rig.key` makes one.
//!
//! An operator reads its key through the pipeline's files, so the session keeps the key, because a replay has to make
//! the same datagrams. **A session holds the key of its run**: anyone who has the session has the key. Give a key to
//! one rig only, and change it before you give a session to someone else.

use hmac::{Hmac, Mac};
use sha2::Sha256;

/// Bytes of a key.
pub const KEY_SIZE: usize = 32;
/// Bytes of a keyed message authentication code.
pub const MAC_SIZE: usize = 32;

/// A shared key. Its bytes are never printed.
#[derive(Clone)]
pub struct Key(Hmac<Sha256>);

/// The key of the simulated rigs, which everybody knows: its file may be read by others.
const EXAMPLE: &str = "6f1d2c9be0a4738455c81e37fa0260b9d3974ae1185f6c20be7390cc42a8d5f7";

/// Why there is no key.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum KeyError {
    /// A character that is no hexadecimal digit.
    #[error(
        "line {line} of the key file has a character at {column} that is not a hexadecimal digit: a key is 64 of 0-9 and a-f"
    )]
    Digit {
        /// Line, from 1.
        line: usize,
        /// Byte in the line, from 1.
        column: usize,
    },
    /// Another number of digits.
    #[error("the key file has {found} hexadecimal digits, but a key is 64 of them (32 bytes)")]
    Length { found: usize },
    /// All bytes are the same: this key was not drawn at random.
    #[error("all 32 bytes of the key are the same: draw one with `openssl rand -hex 32`")]
    Uniform,
}

impl Key {
    /// Reads a key from the text of its file.
    ///
    /// # Errors
    /// The place of a character that is no digit, another number of digits, or a key that nobody drew.
    pub fn parse(text: &[u8]) -> Result<Self, KeyError> {
        let mut bytes = [0u8; KEY_SIZE];
        let mut digits = 0;
        for (line, content) in text.split(|b| *b == b'\n').enumerate() {
            if content.first() == Some(&b'#') {
                continue;
            }
            for (column, byte) in content.iter().enumerate() {
                if byte.is_ascii_whitespace() {
                    continue;
                }
                let digit = char::from(*byte)
                    .to_digit(16)
                    .ok_or(KeyError::Digit { line: line + 1, column: column + 1 })?;
                if let Some(slot) = bytes.get_mut(digits / 2) {
                    *slot = *slot << 4 | digit as u8;
                }
                digits += 1;
            }
        }
        if digits != 2 * KEY_SIZE {
            return Err(KeyError::Length { found: digits });
        }
        if bytes.iter().all(|b| *b == bytes[0]) {
            return Err(KeyError::Uniform);
        }
        Self::from_bytes(&bytes)
    }

    /// Whether the text of a key file is the published example.
    #[must_use]
    pub fn is_example(text: &[u8]) -> bool {
        let lines = text.split(|b| *b == b'\n').filter(|line| line.first() != Some(&b'#'));
        let digits = lines.flatten().filter(|b| !b.is_ascii_whitespace()).map(u8::to_ascii_lowercase);
        digits.eq(EXAMPLE.bytes())
    }

    /// The key of these bytes.
    fn from_bytes(bytes: &[u8; KEY_SIZE]) -> Result<Self, KeyError> {
        Hmac::new_from_slice(bytes).map(Self).map_err(|_| KeyError::Length { found: 2 * bytes.len() })
    }

    /// The code of a message.
    #[must_use]
    pub fn code(&self, message: &[u8]) -> [u8; MAC_SIZE] {
        self.0.clone().chain_update(message).finalize().into_bytes().into()
    }

    /// Whether this is the code of the message, compared in constant time.
    #[must_use]
    pub fn confirms(&self, message: &[u8], code: &[u8]) -> bool {
        self.0.clone().chain_update(message).verify_slice(code).is_ok()
    }
}

impl std::fmt::Debug for Key {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Key(..)")
    }
}
