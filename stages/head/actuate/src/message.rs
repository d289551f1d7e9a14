//! What a datagram says: an order to valves or to the beam, for a time, in a session.

use stillpoint_operator::Choice;
use stillpoint_operator::activation::RandomKey;

use crate::key::Key;

/// Valves that a datagram has room for.
pub const VALVES: usize = 16;
/// The longest life of an order, ns.
pub const LONGEST_LIFE: u64 = 1_000_000_000;

/// Whom a datagram is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Receiving {
    /// The valves.
    Valves = 1,
    /// The beam.
    Beam = 2,
}

/// The order to the far end while the datagram is valid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Order {
    /// Valves: all shut. Beam: off.
    Hold = 0,
    /// Valves: inlets shut, outlets open. Not for the beam.
    Vent = 1,
    /// Valves: the duties. Beam: on.
    Follow = 2,
}

/// The safe state of the valves when no datagram is valid.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
#[repr(u8)]
pub enum Safe {
    /// All shut.
    Hold = 0,
    /// Inlets shut, outlets open.
    Vent = 1,
}

/// A life of a sender. Sessions of one key are ordered by when they started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Session {
    /// Time of the sender's first activation, ns since the epoch.
    pub started: u64,
    /// Drawn from the key, the start, the pipeline's seed, the operator's name and its incarnation.
    pub nonce: u64,
}

impl Session {
    /// The session of a sender whose first activation is at `started`, with that activation's key of random numbers.
    ///
    /// All that it is made from is in the journal, so a replay makes the same datagrams. Two sessions share a nonce only
    /// if they are one operator of one pipeline started at the same nanosecond: two simulated runs, which start at 0.
    #[must_use]
    pub fn begun(key: &Key, started: u64, random: &RandomKey) -> Self {
        let mut text = [0u8; 48];
        text[..20].copy_from_slice(b"stillpoint session 1");
        text[20..28].copy_from_slice(&started.to_le_bytes());
        text[28..36].copy_from_slice(&random.seed.to_le_bytes());
        text[36..44].copy_from_slice(&random.operator.to_le_bytes());
        text[44..].copy_from_slice(&random.incarnation.to_le_bytes());
        let code = key.code(&text);
        let mut nonce = [0u8; 8];
        nonce.copy_from_slice(&code[..8]);
        Self { started, nonce: u64::from_le_bytes(nonce) }
    }
}

/// What a datagram says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Message {
    /// Whom it is for.
    pub receiving: Receiving,
    /// The order while it is valid.
    pub order: Order,
    /// The safe state of the valves when no datagram is valid; [`Safe::Hold`] for the beam.
    pub safe: Safe,
    /// The sender's life.
    pub session: Session,
    /// Its number in the session: each datagram has a higher one than the one before.
    pub sequence: u64,
    /// When it was made, ns since the epoch, by the sender's clock.
    pub stamp: u64,
    /// Time for which it is valid, ns: whole microseconds, above 0 and at most `LONGEST_LIFE`.
    pub life: u64,
    /// Why the order is what it is, as bits that the sender's kind names. For people: no receiver acts on it.
    pub reasons: u32,
    /// How many of `duty` count.
    pub valves: usize,
    /// Parts of full opening, 0 to 1. Zero beyond `valves`, and everywhere where the order is not to follow.
    pub duty: [f32; VALVES],
}

impl Message {
    /// A message that asks for nothing.
    #[must_use]
    pub const fn resting(receiving: Receiving, session: Session) -> Self {
        Self {
            receiving,
            order: Order::Hold,
            safe: Safe::Hold,
            session,
            sequence: 0,
            stamp: 0,
            life: 60_000_000,
            reasons: 0,
            valves: 0,
            duty: [0.0; VALVES],
        }
    }

    /// The duties that count.
    #[must_use]
    pub fn duties(&self) -> &[f32] {
        self.duty.get(..self.valves).unwrap_or(&self.duty)
    }
}
