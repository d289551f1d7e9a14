//! Messages: a JSON value and byte strings, each with its length before it.

use std::io::{self, Read, Write};

use serde_json::Value;
use zerocopy::IntoBytes;

/// Most bytes of the JSON value.
const MOST_HEAD: u32 = 16 << 20;
/// Most byte strings.
const MOST_STRINGS: u32 = 1 << 14;
/// Most bytes of all byte strings together.
const MOST_BYTES: u64 = 1 << 30;

/// Bytes that are aligned as the elements of samples are.
#[derive(Clone, Debug, Default)]
pub struct Bytes {
    words: Vec<u64>,
    length: usize,
}

impl Bytes {
    /// Zeros.
    pub fn zeros(length: usize) -> Self {
        Self { words: vec![0; length.div_ceil(size_of::<u64>())], length }
    }

    /// The bytes.
    pub fn get(&self) -> &[u8] {
        &self.words.as_bytes()[..self.length]
    }

    /// Drops what is behind so many bytes.
    pub fn shorten(&mut self, length: usize) {
        self.length = self.length.min(length);
    }

    /// The bytes, to be written.
    pub fn get_mut(&mut self) -> &mut [u8] {
        &mut self.words.as_mut_bytes()[..self.length]
    }
}

/// A message that was received.
#[derive(Debug)]
pub struct Message {
    /// The value.
    pub head: Value,
    /// The byte strings.
    pub strings: Vec<Bytes>,
}

/// Sends a message.
///
/// # Errors
/// The other side is gone, or the value is too large.
pub fn send(stream: &mut impl Write, head: &Value, strings: &[&[u8]]) -> io::Result<()> {
    let head = head.to_string();
    let lengths = [head.len(), strings.len()].map(|n| u32::try_from(n).map_err(|_| too_large()));
    let [head_length, count] = lengths;
    let mut start = Vec::with_capacity(8 + 8 * strings.len() + head.len());
    start.extend(head_length?.to_le_bytes());
    start.extend(count?.to_le_bytes());
    strings.iter().for_each(|string| start.extend((string.len() as u64).to_le_bytes()));
    start.extend(head.as_bytes());
    stream.write_all(&start)?;
    strings.iter().try_for_each(|string| stream.write_all(string))?;
    stream.flush()
}

/// Receives a message; `None` where the other side is gone.
///
/// # Errors
/// The stream ends within a message, or what arrives is not one.
pub fn receive(stream: &mut impl Read) -> io::Result<Option<Message>> {
    let mut first = [0; 4];
    if !is_filled(stream, &mut first)? {
        return Ok(None);
    }
    let head_length = u32::from_le_bytes(first);
    let mut four = [0; 4];
    stream.read_exact(&mut four)?;
    let count = u32::from_le_bytes(four);
    if head_length > MOST_HEAD || count > MOST_STRINGS {
        return Err(too_large());
    }
    let mut lengths = Vec::new();
    for _ in 0..count {
        let mut eight = [0; 8];
        stream.read_exact(&mut eight)?;
        lengths.push(u64::from_le_bytes(eight));
    }
    let whole = lengths.iter().try_fold(0_u64, |sum, length| sum.checked_add(*length));
    if whole.is_none_or(|bytes| bytes > MOST_BYTES) {
        return Err(too_large());
    }
    let mut head = vec![0; head_length as usize];
    stream.read_exact(&mut head)?;
    let head = serde_json::from_slice(&head)?;
    let mut strings = Vec::new();
    for length in lengths {
        let mut bytes = Bytes::zeros(length as usize);
        stream.read_exact(bytes.get_mut())?;
        strings.push(bytes);
    }
    Ok(Some(Message { head, strings }))
}

/// Fills a buffer; false where the stream ends before its first byte.
fn is_filled(stream: &mut impl Read, buffer: &mut [u8]) -> io::Result<bool> {
    let mut filled = 0;
    while filled < buffer.len() {
        match stream.read(&mut buffer[filled..]) {
            Ok(0) if filled == 0 => return Ok(false),
            Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(n) => filled += n,
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
    Ok(true)
}

fn too_large() -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, "a message is larger than messages may be")
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_message_arrives_as_it_was_sent_and_a_cut_one_does_not() {
        let mut stream = Vec::new();
        send(&mut stream, &json!({ "op": "step" }), &[b"abc", b"", &[7; 4096]]).unwrap();
        let message = receive(&mut &stream[..]).unwrap().unwrap();
        assert_eq!(message.head["op"], "step");
        let strings: Vec<&[u8]> = message.strings.iter().map(Bytes::get).collect();
        assert_eq!(strings, [&b"abc"[..], b"", &[7; 4096]]);
        assert!(receive(&mut &stream[..0]).unwrap().is_none());
        for cut in 1..stream.len() {
            assert!(receive(&mut &stream[..cut]).is_err(), "{cut}");
        }
        // Lengths that no message has are refused before there is memory for them.
        for lengths in [vec![1 << 31], vec![u64::MAX, 2], vec![1 << 29; 3]] {
            let mut stated = [2_u32.to_le_bytes(), (lengths.len() as u32).to_le_bytes()].concat();
            lengths.iter().for_each(|length: &u64| stated.extend(length.to_le_bytes()));
            stated.extend(b"{}");
            assert_eq!(receive(&mut &stated[..]).unwrap_err().kind(), io::ErrorKind::InvalidData);
        }
        let garbage = b"Usage: ls [OPTION]... [FILE]...\n";
        assert!(receive(&mut &garbage[..]).is_err());
    }
}
