//! The sending end of datagrams: one session, numbers that grow, a code on each.

use stillpoint_operator::Activation;
use stillpoint_operator::StepError;

use crate::datagram::{LONGEST, encode};
use crate::key::Key;
use crate::message::{Message, Order, Receiving, Safe, Session, VALVES};

/// Sends the datagrams of one operator. Its session begins with its first activation.
#[derive(Clone, Debug)]
pub struct Sender {
    key: Key,
    receiving: Receiving,
    safe: Safe,
    life: u64,
    session: Option<Session>,
    sequence: u64,
    bytes: [u8; LONGEST],
}

impl Sender {
    /// A sender before its first datagram. `life` is in ns.
    #[must_use]
    pub fn new(key: Key, receiving: Receiving, safe: Safe, life: u64) -> Self {
        Self { key, receiving, safe, life, session: None, sequence: 0, bytes: [0; LONGEST] }
    }

    /// The bytes of an order. Duties count with an order to follow only.
    ///
    /// # Errors
    /// The order cannot be sent: a fault of this stage.
    pub fn datagram(
        &mut self,
        activation: &Activation<'_>,
        order: Order,
        reasons: u32,
        duties: &[f32],
    ) -> Result<&[u8], StepError> {
        let session =
            *self.session.get_or_insert_with(|| Session::begun(&self.key, activation.time, &activation.key));
        let mut message = Message {
            order,
            safe: self.safe,
            sequence: self.sequence,
            stamp: activation.time,
            life: self.life,
            reasons,
            valves: duties.len().min(VALVES),
            ..Message::resting(self.receiving, session)
        };
        if order == Order::Follow {
            for (slot, duty) in message.duty.iter_mut().zip(duties) {
                *slot = *duty;
            }
        }
        let length = encode(&message, &self.key, &mut self.bytes).map_err(|e| StepError(e.to_string()))?;
        self.sequence += 1;
        self.bytes.get(..length).ok_or_else(|| StepError("a datagram is longer than its room".into()))
    }

    /// The session; zero before the first datagram.
    #[must_use]
    pub fn session(&self) -> Session {
        self.session.unwrap_or_default()
    }

    /// How many datagrams were sent.
    #[must_use]
    pub fn sent(&self) -> u64 {
        self.sequence
    }

    /// Number of the last datagram; 0 before it, too.
    #[must_use]
    pub fn sequence(&self) -> u64 {
        self.sequence.saturating_sub(1)
    }
}
