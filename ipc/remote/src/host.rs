//! One end of the network: its two sessions, its ends, and its threads.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, Weak};
use std::thread::JoinHandle;

use stillpoint_transport::Channel;
use zenoh::Wait;
use zenoh::pubsub::Subscriber;
use zenoh::qos::Priority;

use crate::beat::LONGEST_NAME;
use crate::declare::{publisher, subscriber};
use crate::lane::{Lane, LaneShared};
use crate::peers::Peers;
use crate::receiver::{Incoming, RemoteReceiver};
use crate::sender::{Outgoing, RemoteSender};
use crate::shared::{Shared, lock};
use crate::{Endpoints, HostEvent, HostIdentity, Offset, PeerReport, RemoteError, Sent, Taken, names, watch};

/// What a host is.
pub struct HostSettings {
    /// First part of all keys.
    pub prefix: String,
    /// Its name.
    pub name: String,
    /// Where it listens and connects.
    pub endpoints: Endpoints,
    /// What it runs.
    pub identity: HostIdentity,
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
        let beats = subscriber(&shared.small, &names::all_beats(&prefix), with(&weak, Shared::receive))?;
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
