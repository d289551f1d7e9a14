//! What the threads and ends of a host share, and what they tell each other.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use stillpoint_transport::Channel;
use zenoh::Session;
use zenoh::pubsub::Publisher;

use crate::beat::Sends;
use crate::beating::sends;
use crate::lane::{Lane, LaneShared};
use crate::peers::Peers;
use crate::receiver::Incoming;
use crate::sender::Outgoing;
use crate::{Endpoints, HostSettings, names};

/// How long the counts of an end that was closed are told.
const REPORTED: Duration = Duration::from_secs(1);

/// What the threads and ends of a host share.
pub struct Shared {
    pub settings: HostSettings,
    pub small: Session,
    pub bulk: Session,
    pub beats: Publisher<'static>,
    pub acknowledgements: Publisher<'static>,
    pub lanes: [LaneShared; 2],
    /// There is a newer certificate than that with which this host listens.
    pub is_outdated: AtomicBool,
    // Locked in this order: ends, then peers.
    pub ends: Mutex<Ends>,
    pub peers: Mutex<Peers>,
    pub due: Mutex<Due>,
    pub signal: Condvar,
    /// Signalled at the end, with `due`.
    pub closing: Condvar,
    pub next_end: AtomicU64,
}

/// The open ends, and what the last beats tell of closed ones.
#[derive(Default)]
pub struct Ends {
    pub outgoing: Vec<Arc<Outgoing>>,
    pub incoming: Vec<Arc<Incoming>>,
    /// Counts of closed ends, until when they are told.
    pub closed: Vec<(Instant, Sends)>,
    /// Number of the last beat.
    pub number: u64,
}

/// What the thread that beats has to do.
#[derive(Default)]
pub struct Due {
    /// A beat is due before its time.
    pub beat: bool,
    /// By end: the newest bulk sample that arrived.
    pub acknowledge: BTreeMap<u64, u64>,
    pub is_closed: bool,
}

/// Locks, whatever happened to a thread that held the lock.
pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shared {
    pub fn now(&self) -> u64 {
        (self.settings.clock)()
    }

    pub fn endpoints(&self) -> &Endpoints {
        &self.settings.endpoints
    }

    /// Whether no other host is heard.
    pub fn is_alone(&self) -> bool {
        !lock(&self.peers).is_any_alive()
    }

    /// Tells a reason for which nothing can be exchanged.
    pub fn fault(&self, text: String) {
        lock(&self.peers).note(text, true);
    }

    /// Tells what needs no hurry.
    pub fn note(&self, text: String) {
        lock(&self.peers).note(text, false);
    }

    /// Waits. Gives whether the host goes on.
    pub fn goes_on_after(&self, wait: Duration) -> bool {
        let until = Instant::now() + wait;
        let mut due = lock(&self.due);
        loop {
            let rest = until.saturating_duration_since(Instant::now());
            if due.is_closed || rest.is_zero() {
                return !due.is_closed;
            }
            due = self.closing.wait_timeout(due, rest).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    pub fn lane(&self, lane: Lane) -> &LaneShared {
        &self.lanes[lane as usize]
    }

    pub fn session(&self, lane: Lane) -> &Session {
        if lane == Lane::Small { &self.small } else { &self.bulk }
    }

    pub fn key(&self, edge: &str, channel: &Channel) -> String {
        names::samples(&self.settings.prefix, &self.settings.identity.pipeline, edge, channel)
    }

    pub fn remove_sender(&self, outgoing: &Arc<Outgoing>) {
        let mut ends = lock(&self.ends);
        ends.outgoing.retain(|o| !Arc::ptr_eq(o, outgoing));
        ends.closed.push((Instant::now() + REPORTED, sends(outgoing)));
        drop(ends);
        self.beat_soon();
    }

    pub fn remove_receiver(&self, incoming: &Arc<Incoming>) {
        lock(&self.ends).incoming.retain(|i| !Arc::ptr_eq(i, incoming));
        self.beat_soon();
    }

    pub fn beat_soon(&self) {
        lock(&self.due).beat = true;
        self.signal.notify_one();
    }

    /// A beat of another host has arrived.
    pub fn receive(&self, key: &str, bytes: &[u8]) {
        let now = self.now();
        if lock(&self.peers).receive(key, bytes, now) {
            self.beat_soon();
        }
        self.refresh();
    }

    /// Acknowledgements of another host have arrived: pairs of end and number.
    pub fn acknowledged(&self, _: &str, bytes: &[u8]) {
        let ends = lock(&self.ends);
        for pair in bytes.chunks_exact(16) {
            let number = |at: usize| pair[at..at + 8].try_into().map_or(0, u64::from_le_bytes);
            if let Some(outgoing) = ends.outgoing.iter().find(|o| o.end == number(0)) {
                outgoing.acknowledge(number(8));
                self.lane(outgoing.lane).wake();
            }
        }
    }

    /// Tells every end how it stands.
    pub fn refresh(&self) {
        let ends = lock(&self.ends);
        let peers = lock(&self.peers);
        for outgoing in &ends.outgoing {
            outgoing.set_state(peers.of_sender(&outgoing.edge, &outgoing.channel, outgoing.announced));
            peers.confirmed(&outgoing.edge, outgoing.end).into_iter().for_each(|c| outgoing.confirm(c));
        }
        for incoming in &ends.incoming {
            let (state, senders) = peers.of_receiver(&incoming.edge, &incoming.channel);
            incoming.set_senders(state, senders);
        }
    }
}
