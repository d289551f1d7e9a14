//! Where the bridge hands over the samples of another host: a topic of shared memory in place of a transport. A message is
//! the offset of the other host's clock with its uncertainty, and the sample as it arrived.

use stillpoint_operator::outside::ClockOffset;
use stillpoint_samples::{HEADER_SIZE, Header};
use stillpoint_shm::{Contract, Domain, Publisher, ShmError, Subscriber, Topic};
use stillpoint_transport::{LinkState, Origin, Receiver, TransportError};
use zerocopy::IntoBytes;

/// Bytes of offset and uncertainty.
pub const CLOCK_SIZE: usize = 16;

/// Takes the samples that the bridge puts into shared memory.
pub struct Landing {
    subscriber: Subscriber,
    /// Keeps the service alive while this process has a port on it.
    _topic: Topic,
}

impl Landing {
    /// Opens the topic.
    pub fn open(domain: &Domain, contract: &Contract) -> Result<Self, ShmError> {
        let topic = Topic::open(domain, contract)?;
        Ok(Self { subscriber: topic.subscriber(contract.buffer)?, _topic: topic })
    }

    /// The oldest message that waits, and the clock of its host.
    fn receive(&self, bytes: &mut Vec<u8>) -> Result<Option<ClockOffset>, ShmError> {
        let Some(message) = self.subscriber.receive()? else { return Ok(None) };
        let pieces = message.pieces();
        let length = pieces.header().count as usize;
        let (clock, sample) = pieces.payload[..length.min(pieces.payload.len())]
            .split_at_checked(CLOCK_SIZE)
            .unwrap_or((&[0; CLOCK_SIZE], &[]));
        let number = |at: usize| clock[at..at + 8].try_into().map_or(0, i64::from_le_bytes);
        bytes.clear();
        bytes.extend_from_slice(sample);
        Ok(Some(ClockOffset { offset: number(0), uncertainty: number(8) }))
    }
}

/// Hands over a sample of another host. Gives whether there was room for it.
pub fn put(publisher: &Publisher, number: u64, clock: ClockOffset, sample: &[u8]) -> Result<bool, ShmError> {
    let length = CLOCK_SIZE + sample.len();
    let Some(mut loan) = publisher.loan(length)? else { return Ok(false) };
    let count = u32::try_from(length).unwrap_or(u32::MAX);
    let header = Header { stamp: 0, origin: 0, sequence: number, incarnation: 0, count };
    let (meta, payload) = loan.parts_mut();
    meta[..HEADER_SIZE].copy_from_slice(header.as_bytes());
    payload[..8].copy_from_slice(&clock.offset.to_le_bytes());
    payload[8..CLOCK_SIZE].copy_from_slice(&clock.uncertainty.to_le_bytes());
    payload[CLOCK_SIZE..length].copy_from_slice(sample);
    publisher.send(loan).map(|_| true)
}

/// Where the far end of a link takes its samples from.
pub enum Inflow {
    /// A transport.
    Link(Box<dyn Receiver>),
    /// The bridge.
    Bridge(Box<Landing>),
}

impl Inflow {
    /// The oldest message that waits, with the clock of its host where that has one of its own: see
    /// [`Receiver::receive`].
    pub fn receive(
        &mut self,
        bytes: &mut Vec<u8>,
    ) -> Result<Option<(Origin, Option<ClockOffset>)>, TransportError> {
        match self {
            Self::Link(receiver) => Ok(receiver.receive(bytes)?.map(|origin| (origin, None))),
            Self::Bridge(landing) => {
                let clock = landing.receive(bytes).map_err(|e| TransportError::Other(e.to_string()))?;
                Ok(clock.map(|clock| (Origin { sender: None }, Some(clock))))
            }
        }
    }

    /// See [`Receiver::discarded`]. What newer samples replaced in shared memory shows in their numbers.
    pub fn discarded(&mut self) -> u64 {
        match self {
            Self::Link(receiver) => receiver.discarded(),
            Self::Bridge(_) => 0,
        }
    }

    /// See [`Receiver::keeps_waiting`].
    pub fn keeps_waiting(&self) -> bool {
        match self {
            Self::Link(receiver) => receiver.keeps_waiting(),
            Self::Bridge(_) => true,
        }
    }

    /// See [`Receiver::state`].
    pub fn state(&self) -> LinkState {
        match self {
            Self::Link(receiver) => receiver.state(),
            Self::Bridge(_) => LinkState::Open,
        }
    }

    /// Connects to a bridge that begins anew.
    pub fn connect(&self) -> Result<(), ShmError> {
        match self {
            Self::Link(_) => Ok(()),
            Self::Bridge(landing) => landing.subscriber.connect().map(|_| ()),
        }
    }
}
