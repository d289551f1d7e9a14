//! The bytes of a message. All numbers are little-endian.
//!
//! | offset | bytes | what |
//! | --- | --- | --- |
//! | 0 | 4 | `SPDG` |
//! | 4 | 1 | version, 1 |
//! | 5 | 1 | for whom: 1 valves, 2 beam |
//! | 6 | 1 | order: 0 hold or off, 1 vent, 2 follow or on |
//! | 7 | 1 | safe state: 0 hold, 1 vent |
//! | 8 | 8 | start of the session, ns since the epoch |
//! | 16 | 8 | nonce of the session |
//! | 24 | 8 | sequence |
//! | 32 | 8 | stamp, ns since the epoch |
//! | 40 | 4 | life, us |
//! | 44 | 4 | reasons, bits |
//! | 48 | 1 | n, number of duties, 0 to 16 |
//! | 49 | 3 | zero |
//! | 52 | 4 n | duties, `f32` |
//! | 52 + 4 n | 32 | HMAC-SHA-256 of all bytes before it |
//!
//! A message has one encoding, so that a datagram that differs in any bit is another one, or none.

use stillpoint_operator::WireForm;

use crate::key::{Key, MAC_SIZE};
use crate::message::{LONGEST_LIFE, Message, Order, Receiving, Safe, Session, VALVES};
use crate::refusal::DatagramRefusal;
use crate::sealed::{Form, eight, four};

/// Version of the layout.
pub const VERSION: u8 = 1;
/// Bytes of the longest datagram.
pub const LONGEST: usize = HEADER + 4 * VALVES + MAC_SIZE;
/// Bytes of the shortest datagram, one without duties.
pub const SHORTEST: usize = HEADER + MAC_SIZE;

const MAGIC: [u8; 4] = *b"SPDG";
const HEADER: usize = 52;
const FORM: Form = Form { magic: MAGIC, version: VERSION, header: HEADER, count: 48, most: VALVES };
/// What an order looks like from outside.
pub const WIRE: WireForm = WireForm { beginning: &MAGIC, shortest: SHORTEST, longest: LONGEST };
const MICROSECOND: u64 = 1_000;

/// Why a message cannot be sent.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum EncodeError {
    /// More duties than there is room for.
    #[error("{0} valves are more than the {VALVES} of a datagram")]
    Valves(usize),
    /// A duty that no valve can have.
    #[error("the duty of valve {valve} is {duty}, but must be from 0 to 1")]
    Duty {
        /// Number of the valve, from 0.
        valve: usize,
        duty: f32,
    },
    /// A life that is none.
    #[error("a life of {0} ns is not from 1 us to 1 s in whole microseconds")]
    Life(u64),
    /// An order, a safe state or duties that do not go with the rest.
    #[error("the beam knows on and off only, and duties go with an order to follow only")]
    Order,
}

/// Writes a message and its code to the front of `bytes`; gives their length.
///
/// # Errors
/// The message says what a receiver would refuse. Nothing of `bytes` is meaningful then.
pub fn encode(message: &Message, key: &Key, bytes: &mut [u8; LONGEST]) -> Result<usize, EncodeError> {
    let duties = message.duty.get(..message.valves).ok_or(EncodeError::Valves(message.valves))?;
    let unusual = |d: &f32| !is_duty(*d);
    if let Some(valve) = message.duty.iter().position(unusual) {
        return Err(EncodeError::Duty { valve, duty: message.duty[valve] });
    }
    if !is_life(message.life) || !message.life.is_multiple_of(MICROSECOND) {
        return Err(EncodeError::Life(message.life));
    }
    if !is_sound(message) {
        return Err(EncodeError::Order);
    }
    bytes[5] = message.receiving as u8;
    bytes[6] = message.order as u8;
    bytes[7] = message.safe as u8;
    bytes[8..16].copy_from_slice(&message.session.started.to_le_bytes());
    bytes[16..24].copy_from_slice(&message.session.nonce.to_le_bytes());
    bytes[24..32].copy_from_slice(&message.sequence.to_le_bytes());
    bytes[32..40].copy_from_slice(&message.stamp.to_le_bytes());
    bytes[40..44].copy_from_slice(&((message.life / MICROSECOND) as u32).to_le_bytes());
    bytes[44..48].copy_from_slice(&message.reasons.to_le_bytes());
    bytes[49..52].fill(0);
    Ok(FORM.seal(duties, key, bytes))
}

/// The recipient in the bytes, to choose a receiver; the bytes are not yet authenticated.
#[must_use]
pub fn receiving(bytes: &[u8]) -> Option<Receiving> {
    (bytes.get(..4)? == MAGIC).then(|| receiving_of(*bytes.get(5)?)).flatten()
}

/// Reads a datagram: its form first, then its code, then what it says.
///
/// # Errors
/// Why it is refused.
pub fn decode(bytes: &[u8], key: &Key) -> Result<Message, DatagramRefusal> {
    let content = FORM.open(bytes, key)?;
    // Only a holder of the key gets here.
    let order = match bytes[6] {
        0 => Order::Hold,
        1 => Order::Vent,
        2 => Order::Follow,
        _ => return Err(DatagramRefusal::Malformed),
    };
    let safe = match bytes[7] {
        0 => Safe::Hold,
        1 => Safe::Vent,
        _ => return Err(DatagramRefusal::Malformed),
    };
    let (duty, valves) = FORM.numbers::<VALVES>(content);
    let message = Message {
        receiving: receiving_of(bytes[5]).ok_or(DatagramRefusal::Malformed)?,
        order,
        safe,
        session: Session { started: eight(&bytes[8..]), nonce: eight(&bytes[16..]) },
        sequence: eight(&bytes[24..]),
        stamp: eight(&bytes[32..]),
        life: u64::from(u32::from_le_bytes(four(&bytes[40..]))) * MICROSECOND,
        reasons: u32::from_le_bytes(four(&bytes[44..])),
        valves,
        duty,
    };
    if duty.iter().any(|d| !d.is_finite()) {
        return Err(DatagramRefusal::NotFinite);
    }
    if !duty.iter().all(|d| is_duty(*d)) {
        return Err(DatagramRefusal::OutOfRange);
    }
    if !is_life(message.life) {
        return Err(DatagramRefusal::Life);
    }
    if bytes[49..52] != [0; 3] || !is_sound(&message) {
        return Err(DatagramRefusal::Malformed);
    }
    Ok(message)
}

/// A duty that a valve can have. Minus zero is another encoding of zero.
fn is_duty(duty: f32) -> bool {
    (0.0..=1.0).contains(&duty) && duty.is_sign_positive()
}

fn is_life(life: u64) -> bool {
    (MICROSECOND..=LONGEST_LIFE).contains(&life)
}

/// Whether what a message says goes together.
fn is_sound(message: &Message) -> bool {
    let beam = message.receiving == Receiving::Beam;
    let for_beam = message.order != Order::Vent && message.safe == Safe::Hold && message.valves == 0;
    let counted = if message.order == Order::Follow { message.valves } else { 0 };
    (!beam || for_beam) && message.duty.iter().skip(counted).all(|d| *d == 0.0)
}

fn receiving_of(number: u8) -> Option<Receiving> {
    match number {
        1 => Some(Receiving::Valves),
        2 => Some(Receiving::Beam),
        _ => None,
    }
}
