//! What the sender knows of the far end: which orders arrived there, and how long ago the newest of them was made.
//!
//! Each acknowledgement names the newest accepted order by its sequence and its stamp. The stamp is of the sender's own
//! clock, so the age of that order needs no clock that both ends share: an acknowledgement that was held back, or played
//! back, makes the order no newer.

use stillpoint_operator::Params;
use stillpoint_samples::ActuationReason as Reason;

use crate::acknowledgement::Acknowledgement;
use crate::key::Key;
use crate::message::Session;
use crate::refusal::DatagramRefusal;

/// How long lost orders stand among the reasons, ns.
const REPORTED_FOR: u64 = 1_000_000_000;

/// When the far end counts as silent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Params)]
pub struct FarWatchParams {
    /// Age of the newest order that the far end has acknowledged at which the far end counts as silent. This is a
    /// missing condition: the safe state, and a fault after `patience`. Give it more than a period of acknowledgements,
    /// a period of orders and the way there and back. It is used if `acknowledgement` is connected.
    #[param(unit = "ns", default = "80 ms", min = "10 ms", max = "10 s")]
    pub silence: u64,
}

/// Takes acknowledgements.
#[derive(Clone, Debug)]
pub struct FarWatch {
    key: Key,
    silence: u64,
    last: Option<Acknowledgement>,
    /// Orders that far ends before the present one accepted.
    before: u64,
    lost: u64,
    /// When orders were last found lost, ns.
    lost_at: Option<u64>,
    refused: u64,
}

impl FarWatch {
    /// A watch that has heard nothing.
    #[must_use]
    pub fn new(key: Key, params: FarWatchParams) -> Self {
        Self { key, silence: params.silence, last: None, before: 0, lost: 0, lost_at: None, refused: 0 }
    }

    /// Takes bytes that arrived at `now`, ns. `own` is the session of the sender, and `sent` how many orders it sent. A
    /// refusal is counted and changes nothing else.
    ///
    /// # Errors
    /// Why they are refused.
    pub fn take(&mut self, bytes: &[u8], own: Session, sent: u64, now: u64) -> Result<(), DatagramRefusal> {
        let received = self.accepted(bytes, own, sent).inspect_err(|_| self.refused += 1)?;
        // Before its first order the far end has nothing to acknowledge.
        let Some(received) = received else { return Ok(()) };
        if let Some(last) = self.last.filter(|last| last.far != received.far) {
            self.before += last.accepted;
        }
        let lost = (received.sequence + 1).saturating_sub(self.before + received.accepted);
        if lost > self.lost {
            (self.lost, self.lost_at) = (lost, Some(now));
        }
        self.last = Some(received);
        Ok(())
    }

    fn accepted(
        &self,
        bytes: &[u8],
        own: Session,
        sent: u64,
    ) -> Result<Option<Acknowledgement>, DatagramRefusal> {
        let received = Acknowledgement::decode(bytes, &self.key)?;
        if received.session == Session::default() {
            return Ok(None);
        }
        if received.session != own {
            return Err(DatagramRefusal::Recipient);
        }
        if received.sequence >= sent {
            return Err(DatagramRefusal::Malformed);
        }
        let Some(last) = &self.last else { return Ok(Some(received)) };
        if received.far == last.far {
            return match received.number.cmp(&last.number) {
                std::cmp::Ordering::Equal => Err(DatagramRefusal::Repeated),
                std::cmp::Ordering::Less => Err(DatagramRefusal::Old),
                std::cmp::Ordering::Greater if received.sequence < last.sequence => {
                    Err(DatagramRefusal::Malformed)
                }
                std::cmp::Ordering::Greater => Ok(Some(received)),
            };
        }
        if received.far.started <= last.far.started || received.sequence <= last.sequence {
            return Err(DatagramRefusal::OldSession);
        }
        Ok(Some(received))
    }

    /// How old the newest acknowledged order is at `now`, ns; `None` before the first.
    #[must_use]
    pub fn age(&self, now: u64) -> Option<u64> {
        self.last.map(|last| now.saturating_sub(last.order_stamp))
    }

    /// What is missing at `now`, ns, to follow commands.
    #[must_use]
    pub fn missing(&self, now: u64) -> u32 {
        let is_silent = self.age(now).is_none_or(|age| age > self.silence);
        if is_silent { Reason::NO_ANSWER } else { 0 }
    }

    /// What else is out of order at `now`, ns.
    #[must_use]
    pub fn warnings(&self, now: u64) -> u32 {
        let is_recent = self.lost_at.is_some_and(|at| now.saturating_sub(at) < REPORTED_FOR);
        if is_recent { Reason::ORDERS_LOST } else { 0 }
    }

    /// The newest acknowledgement.
    #[must_use]
    pub fn last(&self) -> Option<&Acknowledgement> {
        self.last.as_ref()
    }

    /// Orders of this session that did not arrive, or were refused, up to the newest that is acknowledged.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.lost
    }

    /// Acknowledgements that were refused.
    #[must_use]
    pub fn refused(&self) -> u64 {
        self.refused
    }
}
