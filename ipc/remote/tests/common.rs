//! Two hosts on loopback, and their samples.

use std::net::TcpListener;
use std::sync::Arc;
use std::sync::atomic::{AtomicU16, Ordering};
use std::time::{Duration, Instant};

use stillpoint_remote::{Endpoints, Host, HostIdentity, HostSettings, Remote};
use stillpoint_samples::{AlignedBytes, Datagram, Header, Pieces, Sample};
use stillpoint_transport::{Carries, Channel, Receiver, Sender, Transport, TransportError};
use zerocopy::IntoBytes;

/// Longer than any pause of a machine that is busy.
const PATIENCE: Duration = Duration::from_secs(60);

pub fn retry<T>(mut look: impl FnMut() -> Option<T>) -> T {
    let begun = Instant::now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(begun.elapsed() < PATIENCE, "not in time");
        std::thread::sleep(Duration::from_millis(1));
    }
}

pub fn eventually(claim: &str, mut holds: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !holds() {
        assert!(begun.elapsed() < PATIENCE, "not in time: {claim}");
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// A port that is free together with the next one, below those that the system gives away.
pub fn two_ports() -> u16 {
    static NEXT: AtomicU16 = AtomicU16::new(0);
    let first = 12_000 + (std::process::id() % 900) as u16 * 20;
    loop {
        let port = first + NEXT.fetch_add(2, Ordering::Relaxed);
        let is_free = |port| TcpListener::bind(("127.0.0.1", port)).is_ok();
        if is_free(port) && is_free(port + 1) {
            return port;
        }
    }
}

pub fn identity() -> HostIdentity {
    HostIdentity { pipeline: "test".into(), hash: "1".into(), version: "1".into(), cpu: "x".into() }
}

pub fn listening(port: u16) -> Endpoints {
    Endpoints { listen: vec![format!("tcp/127.0.0.1:{port}")], ..Endpoints::default() }
}

pub fn connecting(port: u16) -> Endpoints {
    Endpoints { connect: vec![format!("tcp/127.0.0.1:{port}")], ..Endpoints::default() }
}

pub fn settings(
    name: &str,
    endpoints: Endpoints,
    identity: HostIdentity,
    incarnation: u64,
    ahead: u64,
) -> HostSettings {
    let begun = Instant::now();
    HostSettings {
        prefix: "stillpoint-test".into(),
        name: name.into(),
        endpoints,
        identity,
        incarnation,
        clock: Arc::new(move || ahead + shared_clock(begun)),
        arrived: Arc::new(|| ()),
    }
}

/// One clock for all hosts of this process.
fn shared_clock(_: Instant) -> u64 {
    static BEGUN: std::sync::OnceLock<Instant> = std::sync::OnceLock::new();
    BEGUN.get_or_init(Instant::now).elapsed().as_nanos() as u64
}

/// A host; the clock of one that listens is 3 s ahead.
pub fn host(name: &str, endpoints: Endpoints, identity: HostIdentity) -> Arc<Host> {
    let ahead = if endpoints.listen.is_empty() { 0 } else { 3_000_000_000 };
    Host::open(settings(name, endpoints, identity, 1, ahead)).unwrap()
}

/// Two hosts: samples go from one to the other.
pub struct Pair {
    pub sender: Arc<Host>,
    pub receiver: Arc<Host>,
}

impl Pair {
    pub fn direct() -> Self {
        let port = two_ports();
        Self::of(host("bedside", listening(port), identity()), port, identity())
    }

    pub fn of(sender: Arc<Host>, port: u16, identity: HostIdentity) -> Self {
        Self { sender, receiver: host("cluster", connecting(port), identity) }
    }

    pub fn edge(&self, name: &str) -> Edge {
        Edge { sender: Remote::new(&self.sender, name), receiver: Remote::new(&self.receiver, name) }
    }
}

/// An edge from one host to the other as one transport.
pub struct Edge {
    sender: Remote,
    receiver: Remote,
}

impl Transport for Edge {
    fn carries(&self) -> Carries {
        self.sender.carries()
    }

    fn open_sender(&self, channel: &Channel) -> Result<Box<dyn Sender>, TransportError> {
        self.sender.open_sender(channel)
    }

    fn open_receiver(&self, channel: &Channel) -> Result<Box<dyn Receiver>, TransportError> {
        self.receiver.open_receiver(channel)
    }
}

pub fn channel(capacity: usize) -> Channel {
    Channel { kind: Datagram::KIND, frame: None, capacity }
}

pub fn link(transport: &dyn Transport, capacity: usize) -> (Box<dyn Sender>, Box<dyn Receiver>) {
    let receiver = transport.open_receiver(&channel(capacity)).unwrap();
    (transport.open_sender(&channel(capacity)).unwrap(), receiver)
}

pub fn datagram(sender: &mut dyn Sender, number: u64, bytes: usize) {
    let header =
        Header { stamp: number, origin: number, sequence: number, incarnation: 0, count: bytes as u32 };
    let sample = AlignedBytes::joined(header.as_bytes(), &vec![number as u8; bytes]);
    sender.send(Pieces::split(Datagram::KIND, &sample).unwrap()).unwrap();
}

/// Sends a small sample, and counts on.
pub fn send(sender: &mut dyn Sender, next: &mut u64) {
    datagram(sender, *next, 64);
    *next += 1;
}
