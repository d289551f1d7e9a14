//! One end of the network: its two sessions, its ends, and the thread that beats.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, Weak};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use stillpoint_transport::Channel;
use zenoh::key_expr::KeyExpr;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::qos::{CongestionControl, Priority};
use zenoh::{Session, Wait};

use crate::beat::{LONGEST_NAME, PROTOCOL, Sends, Takes};
use crate::lane::{Lane, LaneShared};
use crate::peers::Peers;
use crate::receiver::{Incoming, RemoteReceiver};
use crate::sender::{Outgoing, RemoteSender};
use crate::{
    Beat, Endpoints, HostEvent, Identity, Offset, PeerReport, RemoteError, Sent, Taken, names, watch,
};

/// Period of the beats.
const BEAT: Duration = Duration::from_millis(100);
/// The least time between two beats.
const LEAST: Duration = Duration::from_millis(5);
/// How often silent peers are looked for.
const LOOK: Duration = Duration::from_millis(25);
/// How long the counts of an end that was closed are told.
const TOLD: Duration = Duration::from_secs(1);

/// What a host is.
pub struct HostSettings {
    /// First part of all keys.
    pub prefix: String,
    /// Its name.
    pub name: String,
    /// Where it listens and connects.
    pub endpoints: Endpoints,
    /// What it runs.
    pub identity: Identity,
    /// Number of its life: a later one has a higher number.
    pub incarnation: u64,
    /// Its clock, ns.
    pub clock: Arc<dyn Fn() -> u64 + Send + Sync>,
    /// Called when a sample has arrived, on a thread of zenoh: it must return at once.
    pub arrived: Arc<dyn Fn() + Send + Sync>,
}

/// One end of the network.
pub struct Host {
    shared: Arc<Shared>,
    threads: Vec<JoinHandle<()>>,
    _beats: Subscriber<()>,
    _acknowledgements: Subscriber<()>,
}

/// What the threads and ends of a host share.
pub struct Shared {
    settings: HostSettings,
    small: Session,
    bulk: Session,
    beats: Publisher<'static>,
    acknowledgements: Publisher<'static>,
    lanes: [LaneShared; 2],
    /// There is a newer certificate than that with which this host listens.
    pub is_outdated: AtomicBool,
    // Locked in this order: ends, then peers.
    ends: Mutex<Ends>,
    peers: Mutex<Peers>,
    due: Mutex<Due>,
    signal: Condvar,
    /// Signalled at the end, with `due`.
    closing: Condvar,
    next_end: AtomicU64,
}

#[derive(Default)]
struct Ends {
    outgoing: Vec<Arc<Outgoing>>,
    incoming: Vec<Arc<Incoming>>,
    /// Counts of closed ends, until when they are told.
    closed: Vec<(Instant, Sends)>,
    /// Number of the last beat.
    number: u64,
}

#[derive(Default)]
struct Due {
    /// A beat is due before its time.
    beat: bool,
    /// By end: the newest bulk sample that arrived.
    acknowledge: BTreeMap<u64, u64>,
    is_closed: bool,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn declare<T>(key: &str, made: zenoh::Result<T>) -> Result<T, RemoteError> {
    made.map_err(|e| RemoteError::Declare { key: key.to_owned(), reason: e.to_string() })
}

fn publisher(session: &Session, key: String, priority: Priority) -> Result<Publisher<'static>, RemoteError> {
    let expr = declare(&key, KeyExpr::try_from(key.clone()))?;
    let builder = session
        .declare_publisher(expr)
        .congestion_control(CongestionControl::Drop)
        .priority(priority)
        .express(priority == Priority::InteractiveHigh);
    declare(&key, builder.wait())
}

fn subscriber(
    session: &Session,
    key: &str,
    take: impl Fn(zenoh::sample::Sample) + Send + Sync + 'static,
) -> Result<Subscriber<()>, RemoteError> {
    let expr: KeyExpr<'static> = declare(key, KeyExpr::try_from(key.to_owned()))?;
    declare(key, session.declare_subscriber(expr).callback(take).wait())
}

impl Host {
    /// Opens the sessions and begins to beat. It does not wait for any peer, and about a second for a router.
    ///
    /// # Errors
    /// An endpoint is wrong, a port is taken, the router is not there, or a thread cannot be had.
    pub fn open(settings: HostSettings) -> Result<Arc<Self>, RemoteError> {
        if settings.name.is_empty() || settings.name.len() > LONGEST_NAME {
            return Err(RemoteError::Name(settings.name));
        }
        settings.endpoints.check()?;
        if let Some(tls) = &settings.endpoints.tls {
            let role = tls.role();
            if !role.is_host() {
                let instead = "`bedside`, `cluster` or `viewer`";
                return Err(RemoteError::Role { role, what: "exchange samples", instead });
            }
            if !settings.name.starts_with(role.name()) {
                return Err(RemoteError::HostName { host: settings.name, role });
            }
        }
        let open = |lane| settings.endpoints.open(settings.endpoints.mode(), lane, &settings.prefix);
        let (small, bulk) = (open(Lane::Small)?, open(Lane::Bulk)?);
        let (prefix, name) = (settings.prefix.clone(), settings.name.clone());
        let shared = Arc::new(Shared {
            beats: publisher(&small, names::beats(&prefix, &name), Priority::InteractiveHigh)?,
            acknowledgements: publisher(
                &small,
                names::acknowledgements(&prefix, &name),
                Priority::InteractiveHigh,
            )?,
            lanes: Default::default(),
            is_outdated: AtomicBool::new(false),
            ends: Mutex::default(),
            peers: Mutex::new(Peers::new(name, settings.incarnation, settings.identity.clone())),
            due: Mutex::default(),
            signal: Condvar::new(),
            closing: Condvar::new(),
            // Ends of several lives and hosts have different numbers.
            next_end: AtomicU64::new(first_end(&settings.name, settings.incarnation)),
            small,
            bulk,
            settings,
        });
        let weak = Arc::downgrade(&shared);
        let beats = subscriber(&shared.small, &names::all_beats(&prefix), with(&weak, Shared::hear))?;
        let taken = names::all_acknowledgements(&prefix);
        let acknowledgements = subscriber(&shared.small, &taken, with(&weak, Shared::acknowledged))?;
        let mut threads = Vec::new();
        for (name, body) in [
            ("beat", Shared::beat as fn(&Shared)),
            ("small", |shared: &Shared| shared.lane(Lane::Small).run()),
            ("bulk", |shared: &Shared| shared.lane(Lane::Bulk).run()),
            ("watch", watch::run),
        ] {
            let shared = shared.clone();
            let thread = std::thread::Builder::new().name(name.into()).spawn(move || body(&shared));
            threads.push(thread.map_err(|e| RemoteError::Thread(e.to_string()))?);
        }
        Ok(Arc::new(Self { shared, threads, _beats: beats, _acknowledgements: acknowledgements }))
    }

    /// What is known of the peers.
    pub fn peers(&self) -> Vec<PeerReport> {
        lock(&self.shared.peers).reports(self.shared.now())
    }

    /// Whether this host listens with a certificate in whose place a newer one has come: it is to be opened anew. The
    /// others come back by themselves.
    pub fn is_outdated(&self) -> bool {
        self.shared.is_outdated.load(Ordering::Relaxed)
    }

    /// Messages about peers since the last call.
    pub fn events(&self) -> Vec<HostEvent> {
        lock(&self.shared.peers).take_events()
    }

    /// The accounts of the open sending ends, by edge.
    pub fn sent(&self) -> BTreeMap<String, Sent> {
        lock(&self.shared.ends).outgoing.iter().map(|o| (o.edge.clone(), o.sent())).collect()
    }

    /// The accounts of the open taking ends, by edge.
    pub fn taken(&self) -> BTreeMap<String, Taken> {
        lock(&self.shared.ends).incoming.iter().map(|i| (i.edge.clone(), i.taken())).collect()
    }

    /// The clock of the host from which the samples of an edge come, against the clock of this host.
    pub fn offset_of(&self, edge: &str) -> Option<Offset> {
        let peer = lock(&self.shared.ends).incoming.iter().find(|i| i.edge == edge)?.peer()?;
        lock(&self.shared.peers).offset(&peer, self.shared.now())
    }

    /// Opens the sender's end of an edge.
    pub(crate) fn open_sender(&self, edge: &str, channel: &Channel) -> Result<RemoteSender, RemoteError> {
        let shared = &self.shared;
        let lane = Lane::of(channel.longest());
        let publisher = publisher(shared.session(lane), shared.key(edge, channel), Priority::Data)?;
        let end = shared.next_end.fetch_add(1, Ordering::Relaxed);
        let outgoing = {
            let mut ends = lock(&shared.ends);
            let announced = ends.number + 1;
            let names = (edge.to_owned(), channel.name());
            let outgoing = Arc::new(Outgoing::new(names, (end, announced), channel.longest(), publisher));
            ends.outgoing.push(outgoing.clone());
            outgoing
        };
        shared.lane(lane).add(&outgoing);
        shared.refresh();
        shared.beat_soon();
        Ok(RemoteSender { shared: shared.clone(), outgoing, kind: channel.kind, longest: channel.longest() })
    }

    /// Opens the receiver's end of an edge.
    pub(crate) fn open_receiver(&self, edge: &str, channel: &Channel) -> Result<RemoteReceiver, RemoteError> {
        let shared = &self.shared;
        let incoming =
            Arc::new(Incoming::new(edge.to_owned(), channel.name(), channel.kind, channel.longest()));
        let (taker, host) = (incoming.clone(), Arc::downgrade(shared));
        let session = shared.session(incoming.lane);
        let take = move |sample: zenoh::sample::Sample| {
            let attachment = sample.attachment().map(|a| a.to_bytes());
            let payload = sample.payload();
            let taken = taker.take(attachment.as_deref(), payload.len(), payload.slices());
            let Some(shared) = host.upgrade() else { return };
            if let Some((end, number)) = taken.filter(|_| taker.lane == Lane::Bulk) {
                lock(&shared.due).acknowledge.insert(end, number);
                shared.signal.notify_one();
            }
            (shared.settings.arrived)();
        };
        let subscriber = subscriber(session, &shared.key(edge, channel), take)?;
        lock(&shared.ends).incoming.push(incoming.clone());
        shared.refresh();
        shared.beat_soon();
        Ok(RemoteReceiver { shared: shared.clone(), incoming, subscriber: Some(subscriber) })
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        lock(&self.shared.due).is_closed = true;
        self.shared.signal.notify_one();
        self.shared.closing.notify_all();
        self.shared.lanes.iter().for_each(LaneShared::close);
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
        let _ = self.shared.small.close().wait();
        let _ = self.shared.bulk.close().wait();
    }
}

/// A callback that does nothing once the host is gone.
fn with(
    shared: &Weak<Shared>,
    take: fn(&Shared, &str, &[u8]),
) -> impl Fn(zenoh::sample::Sample) + Send + Sync + 'static {
    let shared = shared.clone();
    move |sample| {
        if let Some(shared) = shared.upgrade() {
            take(&shared, sample.key_expr().as_str(), &sample.payload().to_bytes());
        }
    }
}

/// The number of the first end of a host's life: a hash of both, so that no other host has it by chance.
fn first_end(host: &str, incarnation: u64) -> u64 {
    let bytes = host.bytes().chain(incarnation.to_le_bytes());
    let hash =
        bytes.fold(0xcbf2_9ce4_8422_2325_u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3));
    // Room for a million ends; 0 stands for none.
    (hash | 1) & !0xf_fffe
}

impl Shared {
    fn now(&self) -> u64 {
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
        lock(&self.peers).tell(text, true);
    }

    /// Tells what needs no hurry.
    pub fn note(&self, text: String) {
        lock(&self.peers).tell(text, false);
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

    fn session(&self, lane: Lane) -> &Session {
        if lane == Lane::Small { &self.small } else { &self.bulk }
    }

    fn key(&self, edge: &str, channel: &Channel) -> String {
        names::samples(&self.settings.prefix, &self.settings.identity.pipeline, edge, channel)
    }

    pub fn remove_sender(&self, outgoing: &Arc<Outgoing>) {
        let mut ends = lock(&self.ends);
        ends.outgoing.retain(|o| !Arc::ptr_eq(o, outgoing));
        ends.closed.push((Instant::now() + TOLD, sends(outgoing)));
        drop(ends);
        self.beat_soon();
    }

    pub fn remove_receiver(&self, incoming: &Arc<Incoming>) {
        lock(&self.ends).incoming.retain(|i| !Arc::ptr_eq(i, incoming));
        self.beat_soon();
    }

    fn beat_soon(&self) {
        lock(&self.due).beat = true;
        self.signal.notify_one();
    }

    /// A beat of another host has arrived.
    fn hear(&self, key: &str, bytes: &[u8]) {
        let now = self.now();
        if lock(&self.peers).hear(key, bytes, now) {
            self.beat_soon();
        }
        self.refresh();
    }

    /// Acknowledgements of another host have arrived: pairs of end and number.
    fn acknowledged(&self, _: &str, bytes: &[u8]) {
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
    fn refresh(&self) {
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

    /// The body of the thread that beats, acknowledges, and looks for silent peers.
    fn beat(&self) {
        let mut next = Instant::now();
        loop {
            let due = lock(&self.due);
            let wait = next.saturating_duration_since(Instant::now()).min(LOOK);
            let is_idle = !due.beat && !due.is_closed && due.acknowledge.is_empty() && !wait.is_zero();
            let mut due = match is_idle {
                true => self.signal.wait_timeout(due, wait).unwrap_or_else(PoisonError::into_inner).0,
                false => due,
            };
            let acknowledge = std::mem::take(&mut due.acknowledge);
            let (is_closed, is_early) = (due.is_closed, std::mem::take(&mut due.beat));
            drop(due);
            if !acknowledge.is_empty() {
                let pairs =
                    acknowledge.iter().flat_map(|(end, number)| [end.to_le_bytes(), number.to_le_bytes()]);
                let bytes: Vec<u8> = pairs.flatten().collect();
                let _ = self.acknowledgements.put(bytes).wait();
            }
            if is_closed {
                // The last counts.
                self.put_beat();
                return;
            }
            if lock(&self.peers).look() {
                self.refresh();
            }
            let now = Instant::now();
            if now >= next {
                self.put_beat();
                next = now + BEAT;
            } else if is_early {
                next = next.min(now + LEAST);
            }
        }
    }

    fn put_beat(&self) {
        let bytes = {
            let mut ends = lock(&self.ends);
            ends.number += 1;
            let now = Instant::now();
            ends.closed.retain(|(until, _)| *until > now);
            let open = ends.outgoing.iter().map(|o| sends(o));
            let takes = ends.incoming.iter().map(|i| {
                let (from, received, refused) = i.from();
                Takes { edge: i.edge.clone(), channel: i.channel.clone(), from, received, refused }
            });
            let at = self.now();
            Beat {
                protocol: PROTOCOL,
                host: self.settings.name.clone(),
                incarnation: self.settings.incarnation,
                number: ends.number,
                identity: self.settings.identity.clone(),
                at,
                heard: lock(&self.peers).heard(at),
                sends: open.chain(ends.closed.iter().map(|(_, s)| s.clone())).collect(),
                takes: takes.collect(),
            }
            .to_bytes()
        };
        let _ = self.beats.put(bytes).wait();
    }
}

fn sends(outgoing: &Outgoing) -> Sends {
    let put = outgoing.sent().put;
    Sends { edge: outgoing.edge.clone(), channel: outgoing.channel.clone(), end: outgoing.end, put }
}
