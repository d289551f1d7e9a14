//! The far end of datagrams: which are accepted, and what is to be done now.
//!
//! ```
//! use stillpoint_actuate::receiver::{Act, Clock, Receiver, Receives};
//! use stillpoint_actuate::{Key, Message, Order, Receiving, Session, encode};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let key = Key::parse(b"000102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f")?;
//! let mut valves = Receiver::new(key.clone(), Receives::valves(6));
//! assert_eq!(valves.act(0), Act::Vent); // nothing has come yet
//!
//! let session = Session { started: 1_000, nonce: 7 };
//! let mut message = Message { stamp: 1_000, ..Message::resting(Receiving::Valves, session) };
//! let mut bytes = [0; stillpoint_actuate::LONGEST];
//! let n = encode(&message, &key, &mut bytes)?;
//! valves.receive(&bytes[..n], 2_000)?; // a session begins at rest
//! assert_eq!(valves.act(3_000), Act::Hold);
//!
//! (message.sequence, message.order, message.valves, message.duty[0]) = (1, Order::Follow, 6, 0.5);
//! let n = encode(&message, &key, &mut bytes)?;
//! valves.receive(&bytes[..n], 4_000)?;
//! assert!(matches!(valves.act(5_000), Act::Follow(_)));
//! assert!(valves.receive(&bytes[..n], 6_000).is_err()); // repeated
//! # Ok(()) }
//! ```
//!
//! **Lives.** An accepted datagram is obeyed until its life is over: from its stamp where the ends share a clock, from its
//! arrival where they do not. Then the safe state that it names holds; before the first, [`Receives::idle`]. After
//! silence, and in a new session, duties grow from zero over [`Receives::ramp`]: what the sender sent last is not what
//! the valves did last.
//!
//! **Sessions.** A sender draws a nonce when it starts ([`Session::begun`](crate::Session::begun)). A receiver takes numbers of one session only,
//! and each only if it is higher than the last. It goes over to another session only if all of this holds:
//! - no datagram of the present session is valid, so the far end is in its safe state;
//! - the new one started later: an old process that wakes up, or a recording, is refused for good;
//! - it begins with an order to hold or vent: nobody enters a session in motion.
//!
//! A receiver that starts knows no session. Anyone who has recorded datagrams can then play back a whole old session,
//! from a datagram at rest on. A shared clock prevents this, because those datagrams have expired; with [`Clock::Own`]
//! only a change of the key does. A session that starts while the machine's clock is behind the start of the last
//! session is refused as old: restart the far end, too.

use stillpoint_samples::FarEndDoing;

use crate::datagram::decode;
use crate::key::Key;
use crate::message::{Message, Order, Receiving, Safe, VALVES};
use crate::refusal::{Counts, DatagramRefusal};

/// Whether stamps of datagrams and times of arrival are of one clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clock {
    /// They are, but for this many ns. A datagram is refused that comes after its life, or before it was made.
    Shared {
        /// Greatest difference of the clocks, ns.
        within: u64,
    },
    /// They do not share a clock: stamps cannot be compared, and a delayed datagram is not recognised.
    Own,
}

/// What a receiver is told once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Receives {
    /// Whom its datagrams are for.
    pub receiving: Receiving,
    /// Valves that there are: an order to follow must have as many duties. 0 for the beam.
    pub valves: usize,
    /// What to do before the first datagram.
    pub idle: Safe,
    /// Whether the ends share a clock.
    pub clock: Clock,
    /// How long duties grow from zero after silence, ns.
    pub ramp: u64,
}

impl Receives {
    /// The receiver of a rig with this many valves: it vents by itself, shares the sender's clock, and ramps over 100
    /// ms.
    #[must_use]
    pub const fn valves(valves: usize) -> Self {
        let clock = Clock::Shared { within: 5_000_000 };
        Self { receiving: Receiving::Valves, valves, idle: Safe::Vent, clock, ramp: 100_000_000 }
    }

    /// What a beam takes that shares the sender's clock.
    #[must_use]
    pub const fn beam() -> Self {
        Self { receiving: Receiving::Beam, idle: Safe::Hold, ramp: 0, ..Self::valves(0) }
    }
}

/// What is to be done now.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Act {
    /// All valves shut; the beam off.
    Hold,
    /// Inlets shut, outlets open.
    Vent,
    /// Valves at these parts of full opening, zero beyond those that there are; the beam on.
    Follow([f32; VALVES]),
}

impl Act {
    /// Its name in samples.
    #[must_use]
    pub fn doing(&self) -> FarEndDoing {
        match self {
            Self::Hold => FarEndDoing::Holding,
            Self::Vent => FarEndDoing::Venting,
            Self::Follow(_) => FarEndDoing::Following,
        }
    }
}

/// Takes datagrams and gives the present order. It does not allocate.
#[derive(Clone, Debug)]
pub struct Receiver {
    key: Key,
    receives: Receives,
    last: Option<Accepted>,
    counts: Counts,
}

/// The last accepted message.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Accepted {
    message: Message,
    /// When its life is over, ns.
    ends: u64,
    /// Since when there was no silence, ns.
    since: u64,
}

impl Receiver {
    /// A receiver without datagrams.
    #[must_use]
    pub fn new(key: Key, receives: Receives) -> Self {
        Self { key, receives, last: None, counts: Counts::default() }
    }

    /// Takes bytes that arrived at `arrival`, ns. A refusal is counted, and changes nothing else.
    ///
    /// # Errors
    /// Why they are refused.
    pub fn receive(&mut self, bytes: &[u8], arrival: u64) -> Result<&Message, DatagramRefusal> {
        match self.accepted(bytes, arrival) {
            Ok(accepted) => {
                let (before, now) = (self.last.as_ref().map(|l| l.message), &accepted.message);
                let follows = before.filter(|b| b.session == now.session).map(|b| b.sequence);
                self.counts.accepted += 1;
                self.counts.in_session = follows.map_or(1, |_| self.counts.in_session + 1);
                self.counts.sessions += u64::from(follows.is_none());
                self.counts.missing += follows.map_or(0, |before| now.sequence - before - 1);
                Ok(&self.last.insert(accepted).message)
            }
            Err(why) => {
                self.counts.refuse(why);
                Err(why)
            }
        }
    }

    fn accepted(&self, bytes: &[u8], arrival: u64) -> Result<Accepted, DatagramRefusal> {
        let message = decode(bytes, &self.key)?;
        if message.receiving != self.receives.receiving {
            return Err(DatagramRefusal::Recipient);
        }
        if message.order == Order::Follow && message.valves != self.receives.valves {
            return Err(DatagramRefusal::Valves);
        }
        let begins = match self.receives.clock {
            Clock::Own => arrival,
            Clock::Shared { within } => {
                if message.stamp > arrival.saturating_add(within) {
                    return Err(DatagramRefusal::Early);
                }
                if message.stamp.saturating_add(message.life) <= arrival {
                    return Err(DatagramRefusal::Late);
                }
                message.stamp.min(arrival)
            }
        };
        let ends = begins.saturating_add(message.life);
        let Some(last) = self.last else { return self.entered(message, ends, arrival) };
        let present = &last.message;
        if message.session == present.session {
            return match message.sequence.cmp(&present.sequence) {
                std::cmp::Ordering::Equal => Err(DatagramRefusal::Repeated),
                std::cmp::Ordering::Less => Err(DatagramRefusal::Old),
                std::cmp::Ordering::Greater if arrival < last.ends => {
                    Ok(Accepted { message, ends, since: last.since })
                }
                std::cmp::Ordering::Greater => Ok(Accepted { message, ends, since: arrival }),
            };
        }
        if message.session.started <= present.session.started {
            return Err(DatagramRefusal::OldSession);
        }
        if arrival < last.ends {
            return Err(DatagramRefusal::SecondSender);
        }
        self.entered(message, ends, arrival)
    }

    /// Goes over to the session of a message.
    fn entered(&self, message: Message, ends: u64, arrival: u64) -> Result<Accepted, DatagramRefusal> {
        match message.order {
            Order::Follow => Err(DatagramRefusal::InMotion),
            Order::Hold | Order::Vent => Ok(Accepted { message, ends, since: arrival }),
        }
    }

    /// Whether a datagram is valid at `now`, ns.
    #[must_use]
    pub fn is_alive(&self, now: u64) -> bool {
        self.last.as_ref().is_some_and(|last| now < last.ends)
    }

    /// When the present datagram's life is over, ns; `None` before the first.
    #[must_use]
    pub fn ends(&self) -> Option<u64> {
        self.last.as_ref().map(|last| last.ends)
    }

    /// What is to be done at `now`, ns.
    #[must_use]
    pub fn act(&self, now: u64) -> Act {
        let safe = |safe: Safe| match safe {
            Safe::Hold => Act::Hold,
            Safe::Vent => Act::Vent,
        };
        let Some(last) = &self.last else { return safe(self.receives.idle) };
        if now >= last.ends {
            return safe(last.message.safe);
        }
        match last.message.order {
            Order::Hold => Act::Hold,
            Order::Vent => Act::Vent,
            Order::Follow => {
                let grown = now.saturating_sub(last.since);
                let part =
                    if grown >= self.receives.ramp { 1.0 } else { grown as f32 / self.receives.ramp as f32 };
                Act::Follow(last.message.duty.map(|d| part * d))
            }
        }
    }

    /// The last accepted message.
    #[must_use]
    pub fn last(&self) -> Option<&Message> {
        self.last.as_ref().map(|last| &last.message)
    }

    /// What became of all that arrived.
    #[must_use]
    pub fn counts(&self) -> &Counts {
        &self.counts
    }
}
