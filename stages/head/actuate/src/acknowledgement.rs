//! The acknowledgement of orders: what the far end tells the sender, over the same kind of datagrams. All numbers are
//! little-endian.
//!
//! | offset | bytes | content |
//! | --- | --- | --- |
//! | 0 | 4 | `SPDA` |
//! | 4 | 1 | version, 1 |
//! | 5 | 1 | what the valves do: 0 hold, 1 vent, 2 follow |
//! | 6 | 1 | 1 where the beam may be on |
//! | 7 | 1 | n, number of measured pressures, 0 to 8 |
//! | 8 | 16 | session of the newest accepted order: start and nonce; zero before the first |
//! | 24 | 8 | sequence of that order |
//! | 32 | 8 | stamp of that order, by the sender's clock, ns |
//! | 40 | 8 | orders of that session that were accepted |
//! | 48 | 8 | datagrams for the valves that were refused since the far end started |
//! | 56 | 16 | session of the far end: start and nonce |
//! | 72 | 8 | number of this acknowledgement in that session |
//! | 80 | 8 | stamp, by the far end's clock, ns |
//! | 88 | 4 n | measured pressures over that of the room, Pa, `f32` |
//! | 88 + 4 n | 32 | HMAC-SHA-256 of all bytes before it |
//!
//! Its first bytes differ from those of an order, so neither is taken for the other under the one key.

use stillpoint_operator::WireForm;
use stillpoint_samples::FarEndDoing;

use crate::key::{Key, MAC_SIZE};
use crate::message::Session;
use crate::refusal::DatagramRefusal;
use crate::sealed::{Form, eight};

/// Version of the layout.
pub const VERSION: u8 = 1;
/// Pressures that an acknowledgement has room for.
pub const PRESSURES: usize = 8;
/// Bytes of the longest acknowledgement.
pub const LONGEST: usize = SHORTEST + 4 * PRESSURES;
/// Bytes of the shortest, without pressures.
pub const SHORTEST: usize = HEADER + MAC_SIZE;

const MAGIC: [u8; 4] = *b"SPDA";
const HEADER: usize = 88;
const FORM: Form = Form { magic: MAGIC, version: VERSION, header: HEADER, count: 7, most: PRESSURES };
/// What an acknowledgement looks like from outside.
pub const WIRE: WireForm = WireForm { beginning: &MAGIC, shortest: SHORTEST, longest: LONGEST };

/// What the far end says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Acknowledgement {
    /// What the valves do.
    pub doing: FarEndDoing,
    /// Whether the beam may be on.
    pub beam: bool,
    /// Session of the newest accepted order; zero before the first.
    pub session: Session,
    /// Sequence of that order.
    pub sequence: u64,
    /// Stamp of that order, ns, by the clock of its sender.
    pub order_stamp: u64,
    /// Accepted orders of that session.
    pub accepted: u64,
    /// Datagrams for the valves that were refused since the far end started.
    pub refused: u64,
    /// Session of the far end.
    pub far: Session,
    /// Number of this acknowledgement in that session.
    pub number: u64,
    /// When it was made, ns, by the far end's clock.
    pub stamp: u64,
    /// How many of `pressure` count.
    pub bladders: usize,
    /// Measured pressures over that of the room, Pa; zero beyond `bladders`.
    pub pressure: [f32; PRESSURES],
}

impl Acknowledgement {
    /// Writes it and its code to the front of `bytes` and returns their length. A pressure that is not finite is left
    /// out with all others.
    pub fn encode(&self, key: &Key, bytes: &mut [u8; LONGEST]) -> usize {
        let measured = self.pressure.get(..self.bladders).unwrap_or(&self.pressure);
        let measured = if measured.iter().all(|p| p.is_finite()) { measured } else { &[] };
        bytes[5..7].copy_from_slice(&[self.doing as u8, u8::from(self.beam)]);
        let numbers = [
            self.session.started,
            self.session.nonce,
            self.sequence,
            self.order_stamp,
            self.accepted,
            self.refused,
            self.far.started,
            self.far.nonce,
            self.number,
            self.stamp,
        ];
        for (slot, number) in bytes[8..HEADER].chunks_exact_mut(8).zip(numbers) {
            slot.copy_from_slice(&number.to_le_bytes());
        }
        FORM.seal(measured, key, bytes)
    }

    /// Reads one: its form first, then its code, then what it says.
    ///
    /// # Errors
    /// Why it is refused.
    pub fn decode(bytes: &[u8], key: &Key) -> Result<Self, DatagramRefusal> {
        let content = FORM.open(bytes, key)?;
        // Only a holder of the key gets here.
        let doing = match bytes[5] {
            0 => FarEndDoing::Holding,
            1 => FarEndDoing::Venting,
            2 => FarEndDoing::Following,
            _ => return Err(DatagramRefusal::Malformed),
        };
        let (pressure, bladders) = FORM.numbers::<PRESSURES>(content);
        if pressure.iter().any(|p| !p.is_finite()) {
            return Err(DatagramRefusal::NotFinite);
        }
        let number = |place: usize| eight(&content[8 + 8 * place..]);
        let found = Self {
            doing,
            beam: bytes[6] == 1,
            session: Session { started: number(0), nonce: number(1) },
            sequence: number(2),
            order_stamp: number(3),
            accepted: number(4),
            refused: number(5),
            far: Session { started: number(6), nonce: number(7) },
            number: number(8),
            stamp: number(9),
            bladders,
            pressure,
        };
        // Of a session whose last number is n at most n + 1 orders can have been accepted.
        let counts = found.accepted <= found.sequence.saturating_add(1);
        if bytes[6] > 1 || !counts { Err(DatagramRefusal::Malformed) } else { Ok(found) }
    }

    /// The measured pressures over that of the room, Pa; empty where none are measured.
    #[must_use]
    pub fn pressures(&self) -> &[f32] {
        self.pressure.get(..self.bladders).unwrap_or(&self.pressure)
    }
}
