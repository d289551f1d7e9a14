//! The receiver's end of an edge: what arrives is checked, and waits in a bounded queue.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use stillpoint_samples::{HEADER_SIZE, Pieces, SampleKind};
use stillpoint_transport::{LinkRefusal, LinkState, Origin, Receiver, TransportError};
use zenoh::pubsub::Subscriber;
use zerocopy::IntoBytes;

use crate::Attachment;
use crate::beat::Sends;
use crate::lane::Lane;
use crate::shared::Shared;

/// Small samples that wait at this end; one on top costs the oldest.
const MOST_SMALL: usize = 64;
/// Bulk samples that wait.
const MOST_BULK: usize = 3;
/// How far the number of a sample may be ahead of what the sender has said.
const AHEAD: u64 = 1_000_000;

/// The account of a taking end: all samples that the senders have put since this end was opened are
/// `received + refused + lost + missing`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Taken {
    /// Samples that arrived.
    pub received: u64,
    /// Samples that arrived and were not valid.
    pub refused: u64,
    /// Samples that were lost on the link.
    pub lost: u64,
    /// Samples that the sender has put and that have not arrived: under way, or lost.
    pub missing: u64,
    /// Samples of `received` that newer ones replaced at this end.
    pub discarded: u64,
    /// Messages that belong to no sample: of an unknown sender, a repetition, a broken attachment.
    pub strange: u64,
}

/// What subscriber, receiver and beats share of a taking end.
pub struct Incoming {
    pub edge: String,
    pub channel: String,
    pub lane: Lane,
    kind: &'static SampleKind,
    longest: usize,
    arrived: Mutex<Arrived>,
}

struct Arrived {
    waiting: VecDeque<Vec<u8>>,
    /// Buffers to be used again.
    spare: Vec<Vec<u8>>,
    taken: Taken,
    /// Discarded since the receiver last asked.
    discarded: u64,
    state: LinkState,
    /// Why the last sample was refused.
    refusal: Option<LinkRefusal>,
    /// The sending ends that may send.
    senders: Vec<Known>,
    /// The end whose sample came last.
    from: Option<From>,
}

/// A sending end that may send.
struct Known {
    host: String,
    sends: Sends,
    /// What it had put when this end first heard of it: that was not meant for this end.
    base: u64,
}

/// Counts of the samples of one sending end.
#[derive(Clone, Copy, Default)]
struct From {
    end: u64,
    /// Number of the last sample.
    last: u64,
    /// Samples that it has said to have put.
    put: u64,
    received: u64,
    refused: u64,
}

impl Incoming {
    pub fn new(edge: String, channel: String, kind: &'static SampleKind, longest: usize) -> Self {
        let arrived = Arrived {
            waiting: VecDeque::new(),
            spare: Vec::new(),
            taken: Taken::default(),
            discarded: 0,
            state: LinkState::Waiting,
            refusal: None,
            senders: Vec::new(),
            from: None,
        };
        Self { edge, channel, lane: Lane::of(longest), kind, longest, arrived: Mutex::new(arrived) }
    }

    fn arrived(&self) -> MutexGuard<'_, Arrived> {
        self.arrived.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes what the peers say of the edge.
    pub fn set_senders(&self, state: LinkState, senders: Vec<(String, Sends)>) {
        let mut arrived = self.arrived();
        if arrived.state == LinkState::Closed {
            return;
        }
        if let Some(from) = &mut arrived.from
            && let Some((_, sends)) = senders.iter().find(|(_, s)| s.end == from.end)
        {
            from.put = from.put.max(sends.put);
        }
        arrived.state = state;
        let known = std::mem::take(&mut arrived.senders);
        let base =
            |sends: &Sends| known.iter().find(|k| k.sends.end == sends.end).map_or(sends.put, |k| k.base);
        arrived.senders =
            senders.into_iter().map(|(host, sends)| Known { host, base: base(&sends), sends }).collect();
    }

    /// The sending end, what arrived of it and what was refused.
    pub fn from(&self) -> (u64, u64, u64) {
        self.arrived().from.map_or((0, 0, 0), |f| (f.end, f.received, f.refused))
    }

    pub fn taken(&self) -> Taken {
        let arrived = self.arrived();
        // If nothing has arrived yet, all is missing that was put for this end.
        let waited = || arrived.senders.iter().map(|k| k.sends.put.saturating_sub(k.base)).sum();
        let missing = arrived.from.map_or_else(waited, |f| f.put.saturating_sub(f.last));
        Taken { missing, ..arrived.taken }
    }

    /// The host whose samples come.
    pub fn peer(&self) -> Option<String> {
        let arrived = self.arrived();
        let end = arrived.from?.end;
        arrived.senders.iter().find(|k| k.sends.end == end).map(|k| k.host.clone())
    }

    /// Takes a message. Gives what is to be acknowledged: end and number.
    pub fn take<'b>(
        &self,
        attachment: Option<&[u8]>,
        length: usize,
        body: impl Iterator<Item = &'b [u8]>,
    ) -> Option<(u64, u64)> {
        let mut arrived = self.arrived();
        let arrived = &mut *arrived;
        if arrived.state == LinkState::Closed {
            return None;
        }
        let Some(attachment) = attachment.and_then(Attachment::read) else {
            arrived.taken.strange += 1;
            return None;
        };
        let (end, number) = (attachment.end, attachment.number);
        let Some(Known { host, sends, base }) = arrived.senders.iter().find(|k| k.sends.end == end) else {
            arrived.taken.strange += 1;
            return None;
        };
        let begin = From { end, last: *base, put: *base, ..From::default() };
        let from = arrived.from.get_or_insert(begin);
        if from.end != end {
            // The tail of the end before is known now.
            arrived.taken.lost += from.put.saturating_sub(from.last);
            *from = begin;
        }
        if number <= from.last || number > sends.put.max(from.last).saturating_add(AHEAD) {
            arrived.taken.strange += 1;
            return None;
        }
        from.put = from.put.max(sends.put).max(number);
        arrived.taken.lost += number - from.last - 1;
        from.last = number;
        let bytes = length.saturating_add(HEADER_SIZE);
        let refusal = if bytes > self.longest {
            Some(LinkRefusal::TooLong { peer: host.clone(), bytes, longest: self.longest })
        } else {
            let free = match arrived.waiting.len()
                >= if self.lane == Lane::Small { MOST_SMALL } else { MOST_BULK }
            {
                true => {
                    arrived.taken.discarded += 1;
                    arrived.discarded += 1;
                    arrived.waiting.pop_front()
                }
                false => arrived.spare.pop(),
            };
            let mut whole = free.unwrap_or_default();
            whole.clear();
            whole.reserve(bytes);
            whole.extend_from_slice(attachment.header.as_bytes());
            body.for_each(|slice| whole.extend_from_slice(slice));
            match Pieces::split(self.kind, &whole) {
                Ok(_) => {
                    arrived.waiting.push_back(whole);
                    None
                }
                Err(error) => Some(LinkRefusal::Other(format!(
                    "host `{host}` sends something that is not a sample: {error}"
                ))),
            }
        };
        match refusal {
            None => {
                from.received += 1;
                arrived.taken.received += 1;
            }
            Some(_) => {
                from.refused += 1;
                arrived.taken.refused += 1;
            }
        }
        arrived.refusal = refusal;
        Some((end, number))
    }
}

/// The receiver's end.
pub struct RemoteReceiver {
    pub shared: Arc<Shared>,
    pub incoming: Arc<Incoming>,
    pub subscriber: Option<Subscriber<()>>,
}

impl Receiver for RemoteReceiver {
    fn receive(&mut self, bytes: &mut Vec<u8>) -> Result<Option<Origin>, TransportError> {
        let mut arrived = self.incoming.arrived();
        if arrived.state == LinkState::Closed {
            return Err(TransportError::Closed);
        }
        let Some(sample) = arrived.waiting.pop_front() else { return Ok(None) };
        let spare = std::mem::replace(bytes, sample);
        if arrived.spare.len() < MOST_BULK {
            arrived.spare.push(spare);
        }
        Ok(Some(Origin { sender: None }))
    }

    fn discarded(&mut self) -> u64 {
        std::mem::take(&mut self.incoming.arrived().discarded)
    }

    fn keeps_waiting(&self) -> bool {
        true
    }

    fn state(&self) -> LinkState {
        let arrived = self.incoming.arrived();
        match (&arrived.state, &arrived.refusal) {
            (LinkState::Open, Some(refusal)) => LinkState::Refused(refusal.clone()),
            (state, _) => state.clone(),
        }
    }

    fn close(&mut self) {
        let mut arrived = self.incoming.arrived();
        if arrived.state == LinkState::Closed {
            return;
        }
        arrived.state = LinkState::Closed;
        arrived.waiting.clear();
        drop(arrived);
        self.shared.remove_receiver(&self.incoming);
        self.subscriber = None;
    }
}

impl Drop for RemoteReceiver {
    fn drop(&mut self) {
        self.close();
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use stillpoint_samples::{Datagram, Header, Sample};
    use stillpoint_transport::Channel;

    use super::*;

    /// What was put before the end was opened.
    const BASE: u64 = 5;

    fn incoming() -> Incoming {
        let channel = Channel { kind: Datagram::KIND, frame: None, capacity: 100 };
        let incoming = Incoming::new("a".into(), channel.name(), channel.kind, channel.longest());
        let mut sends = Sends { edge: "a".into(), channel: channel.name(), end: 1, put: BASE };
        incoming.set_senders(LinkState::Open, vec![("bedside".into(), sends.clone())]);
        sends.put = 50;
        incoming.set_senders(LinkState::Open, vec![("bedside".into(), sends)]);
        incoming
    }

    proptest! {
        /// Whatever comes, memory is bounded, nothing that is no sample waits, and each number is in one count.
        #[test]
        fn anything_may_arrive(
            messages in proptest::collection::vec((0_u64..3, any::<u64>(), 0_u64..80, any::<bool>(), 0_u32..120, 0_usize..120), 0..200),
        ) {
            let incoming = incoming();
            for (end, far, near, is_near, count, bytes) in messages {
                let header = Header { stamp: 1, origin: 1, sequence: far, incarnation: 0, count };
                let number = if is_near { near } else { far };
                let attachment = Attachment { header, end, number }.to_bytes();
                let body = vec![0; bytes];
                incoming.take(Some(&attachment[..attachment.len() - usize::from(far % 7 == 0)]), bytes, [&body[..]].into_iter());
            }
            let (taken, arrived) = (incoming.taken(), incoming.arrived());
            prop_assert!(arrived.waiting.len() <= MOST_SMALL && arrived.spare.len() <= MOST_BULK);
            prop_assert!(arrived.waiting.iter().all(|w| Pieces::split(Datagram::KIND, w).is_ok()));
            let (last, put) = arrived.from.map_or((BASE, 50), |f| (f.last, f.put));
            prop_assert_eq!(taken.received + taken.refused + taken.lost, last - BASE);
            prop_assert_eq!(taken.received + taken.refused + taken.lost + taken.missing, put - BASE);
            prop_assert_eq!(taken.received, taken.discarded + arrived.waiting.len() as u64);
        }
    }
}
