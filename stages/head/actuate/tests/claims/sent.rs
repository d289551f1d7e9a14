//! Messages and their bytes, as the tests of the far end send them.

use stillpoint_actuate::{Key, LONGEST, Message, Order, Receiving, Safe, Session, encode};

/// A key for tests.
pub fn key() -> Key {
    Key::parse(b"00112233445566778899aabbccddeeff0123456789abcdef0123456789abcdef").unwrap()
}

/// A session that started at this millisecond.
pub fn session(ms: u64) -> Session {
    Session { started: ms * 1_000_000, nonce: 0x5eed ^ ms }
}

/// An order to six valves, made at this millisecond.
pub fn order(session: Session, sequence: u64, ms: u64, order: Order) -> Message {
    let mut message = Message { sequence, order, ..Message::resting(Receiving::Valves, session) };
    (message.stamp, message.safe, message.valves) = (ms * 1_000_000, Safe::Vent, 6);
    if order == Order::Follow {
        message.duty[..6].copy_from_slice(&[0.5, 0.0, 0.25, 0.0, 0.0, 1.0]);
    }
    message
}

/// The bytes of a message.
pub fn bytes(message: &Message) -> Vec<u8> {
    let mut bytes = [0; LONGEST];
    let n = encode(message, &key(), &mut bytes).unwrap();
    bytes[..n].to_vec()
}

/// Bytes that were changed after they were made, with the code of the new ones: what only a holder of the key can make.
pub fn resealed(mut bytes: Vec<u8>, change: impl FnOnce(&mut [u8])) -> Vec<u8> {
    let end = bytes.len() - 32;
    change(&mut bytes[..end]);
    let code = key().code(&bytes[..end]);
    bytes[end..].copy_from_slice(&code);
    bytes
}
