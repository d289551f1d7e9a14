//! Messages as samples of a topic: an operator and its pool exchange them.

use stillpoint_samples::{LONGEST_POOL_MESSAGE, PoolMessageBody};

use crate::message::PART;
use crate::{Message, To};

// A part with its names and numbers is the longest message of a worker.
const _: () = assert!(PART + 512 <= LONGEST_POOL_MESSAGE);

/// Body and elements of the sample of a message to a worker, or from one.
pub fn sample(peer: &To, message: &Message) -> (PoolMessageBody, Vec<u8>) {
    let name = match peer {
        To::All => "",
        To::One(name) => name,
    };
    let bytes = message.to_bytes();
    let (word, key) = message.summary();
    let mut elements = Vec::with_capacity(1 + name.len() + bytes.len());
    // Names are short: the network knows no name of more than 64 bytes.
    let name = &name.as_bytes()[..name.len().min(usize::from(u8::MAX))];
    elements.push(name.len() as u8);
    elements.extend_from_slice(name);
    elements.extend(bytes);
    let key = key.map_or([0; 4], |key| key.words());
    (PoolMessageBody { key, word: word as u32, length: elements.len() as u32 }, elements)
}

/// Name of the peer (empty: all) and bytes of the message; `None` where the elements are no such sample.
pub fn split(elements: &[u8]) -> Option<(&str, &[u8])> {
    let (length, rest) = elements.split_first()?;
    let (name, message) = rest.split_at_checked(usize::from(*length))?;
    Some((std::str::from_utf8(name).ok()?, message))
}
