//! The sender's end of an edge: a bounded queue before the put.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use stillpoint_samples::{HEADER_SIZE, Header, Pieces, SampleKind};
use stillpoint_transport::{LinkState, Sender, TransportError};
use zenoh::Wait;
use zenoh::pubsub::Publisher;

use crate::Attachment;
use crate::lane::Lane;
use crate::shared::Shared;

/// Small samples that wait to be put; one on top costs the oldest.
const MOST_SMALL: usize = 64;
/// Bulk samples that wait to be put.
const MOST_BULK: usize = 3;
/// Bulk samples that are put and not acknowledged.
const MOST_OUTSTANDING: u64 = 4;
/// Bytes of bulk samples that are put and not acknowledged; one sample may be longer.
const MOST_OUTSTANDING_BYTES: usize = 4 << 20;
/// How long an acknowledgement is waited for: what was put before counts as lost.
const OVERDUE: Duration = Duration::from_secs(2);

/// The account of a sending end: `offered = replaced + unheard + put + waiting`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sent {
    /// Samples given to the sender.
    pub offered: u64,
    /// Samples that newer ones replaced in the queue.
    pub replaced: u64,
    /// Samples that nobody was there to take.
    pub unheard: u64,
    /// Samples handed to the network.
    pub put: u64,
    /// Samples in the queue.
    pub waiting: u64,
    /// Samples of `put` that the other host says it has: what is neither here nor in `refused` is lost or under way.
    pub received: u64,
    /// Samples of `put` that the other host has refused.
    pub refused: u64,
}

/// What another host says of the samples of a sending end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Confirmed {
    /// Life of the other host: in a new one its counts begin anew.
    pub incarnation: u64,
    /// Samples that it has.
    pub received: u64,
    /// Samples that it has refused.
    pub refused: u64,
}

/// What sender, lane and beats share of a sending end.
pub struct Outgoing {
    pub edge: String,
    pub channel: String,
    pub end: u64,
    /// Number of the beat that announced this end.
    pub announced: u64,
    pub lane: Lane,
    publisher: Publisher<'static>,
    queue: Mutex<Queue>,
}

struct Queue {
    waiting: VecDeque<(Header, Vec<u8>)>,
    sent: Sent,
    state: LinkState,
    /// Counts of the other host in its present life.
    confirmed: Confirmed,
    /// Number of the newest sample that was acknowledged, or that is given up.
    acknowledged: u64,
    /// Since when the oldest sample that is not acknowledged is waited for.
    since: Instant,
    most_outstanding: u64,
}

impl Queue {
    /// Whether somebody is there to take a sample; one that nobody takes is counted.
    fn is_requested(&mut self) -> Result<bool, TransportError> {
        match self.state {
            LinkState::Closed => Err(TransportError::Closed),
            LinkState::Open => Ok(true),
            LinkState::Waiting | LinkState::Refused(_) => {
                self.sent.offered += 1;
                self.sent.unheard += 1;
                Ok(false)
            }
        }
    }
}

impl Outgoing {
    pub fn new(
        (edge, channel): (String, String),
        (end, announced): (u64, u64),
        longest: usize,
        publisher: Publisher<'static>,
    ) -> Self {
        let fit = (MOST_OUTSTANDING_BYTES / longest.max(1)) as u64;
        Self {
            edge,
            channel,
            end,
            announced,
            lane: Lane::of(longest),
            publisher,
            queue: Mutex::new(Queue {
                waiting: VecDeque::new(),
                sent: Sent::default(),
                state: LinkState::Waiting,
                confirmed: Confirmed::default(),
                acknowledged: 0,
                since: Instant::now(),
                most_outstanding: fit.clamp(1, MOST_OUTSTANDING),
            }),
        }
    }

    fn queue(&self) -> MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn sent(&self) -> Sent {
        let queue = self.queue();
        Sent {
            waiting: queue.waiting.len() as u64,
            received: queue.sent.received + queue.confirmed.received,
            refused: queue.sent.refused + queue.confirmed.refused,
            ..queue.sent
        }
    }

    pub fn state(&self) -> LinkState {
        self.queue().state.clone()
    }

    /// Changes the state of an end that is not closed. What waits for a taker that is gone is dropped: it would come as
    /// a flood when the taker is back.
    pub fn set_state(&self, state: LinkState) {
        let mut queue = self.queue();
        if queue.state == LinkState::Closed {
            return;
        }
        if state != LinkState::Open {
            queue.sent.unheard += queue.waiting.len() as u64;
            queue.waiting.clear();
        } else if queue.state != LinkState::Open {
            // Whatever was under way when the link broke is not waited for.
            queue.acknowledged = queue.sent.put;
        }
        queue.state = state;
    }

    /// The taker has this sample, and all before it that were not lost.
    pub fn acknowledge(&self, number: u64) {
        let mut queue = self.queue();
        if number > queue.acknowledged && number <= queue.sent.put {
            queue.acknowledged = number;
            queue.since = Instant::now();
        }
    }

    /// Takes what the other host says that it has.
    pub fn confirm(&self, confirmed: Confirmed) {
        let mut queue = self.queue();
        let before = queue.confirmed;
        if confirmed.incarnation != before.incarnation || confirmed.received < before.received {
            queue.sent.received += before.received;
            queue.sent.refused += before.refused;
        }
        queue.confirmed = confirmed;
    }

    fn offer(&self, header: Header, body: &[&[u8]]) -> Result<(), TransportError> {
        if !self.queue().is_requested()? {
            return Ok(());
        }
        // Without the lock: the thread that puts does not wait for this copy.
        let body = body.concat();
        let mut queue = self.queue();
        // The taker may have gone meanwhile.
        if !queue.is_requested()? {
            return Ok(());
        }
        queue.sent.offered += 1;
        let most = if self.lane == Lane::Small { MOST_SMALL } else { MOST_BULK };
        let replaced = if queue.waiting.len() >= most { queue.waiting.pop_front() } else { None };
        queue.sent.replaced += u64::from(replaced.is_some());
        queue.waiting.push_back((header, body));
        drop(queue);
        // Its memory is given back without the lock, too.
        drop(replaced);
        Ok(())
    }

    /// Puts the oldest sample that waits. Gives whether there was one that may go.
    pub fn put_next(&self) -> bool {
        let (attachment, body) = {
            let mut queue = self.queue();
            if queue.state != LinkState::Open || queue.waiting.is_empty() {
                return false;
            }
            if self.lane == Lane::Bulk {
                if queue.sent.put == queue.acknowledged {
                    queue.since = Instant::now();
                }
                if queue.sent.put - queue.acknowledged >= queue.most_outstanding {
                    if queue.since.elapsed() < OVERDUE {
                        return false;
                    }
                    queue.acknowledged = queue.sent.put;
                    queue.since = Instant::now();
                }
            }
            let Some((header, body)) = queue.waiting.pop_front() else { return false };
            queue.sent.put += 1;
            (Attachment { header, end: self.end, number: queue.sent.put }, body)
        };
        // A session that is closed takes nothing: the count shows that it was lost.
        let _ = self.publisher.put(body).attachment(&attachment.to_bytes()[..]).wait();
        true
    }

    fn close(&self) {
        let mut queue = self.queue();
        queue.sent.unheard += queue.waiting.len() as u64;
        queue.waiting.clear();
        queue.state = LinkState::Closed;
    }
}

/// The sender's end.
pub struct RemoteSender {
    pub shared: Arc<Shared>,
    pub outgoing: Arc<Outgoing>,
    pub kind: &'static SampleKind,
    pub longest: usize,
}

impl Sender for RemoteSender {
    fn send(&mut self, sample: Pieces<'_>) -> Result<(), TransportError> {
        let sample = sample.check(self.kind).map_err(TransportError::Sample)?;
        let bytes = sample.meta.len() + sample.payload.len();
        if bytes > self.longest {
            return Err(TransportError::TooLong { bytes, longest: self.longest });
        }
        self.outgoing.offer(sample.header(), &[&sample.meta[HEADER_SIZE..], sample.payload])?;
        self.shared.lane(self.outgoing.lane).wake();
        Ok(())
    }

    fn state(&self) -> LinkState {
        self.outgoing.state()
    }

    fn close(&mut self) {
        if self.state() != LinkState::Closed {
            self.outgoing.close();
            self.shared.remove_sender(&self.outgoing);
        }
    }
}

impl Drop for RemoteSender {
    fn drop(&mut self) {
        self.close();
    }
}
