//! A remote edge beside bare zenoh, between the same two processes, in turns: the time of a round trip, halved. Both
//! are given a sample that is there, and give one whose bytes lie one behind the other, as programs need it.

use std::collections::VecDeque;
use std::process::{Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use stillpoint_remote::{Endpoints, Host, Remote};
use stillpoint_samples::{AlignedBytes, Datagram, HEADER_SIZE, Header, Pieces, Sample};
use stillpoint_transport::{LinkState, Receiver, Sender, Transport};
use zenoh::qos::CongestionControl;
use zenoh::{Session, Wait};
use zerocopy::IntoBytes;

use crate::common::{channel, connecting, eventually, identity, listening, settings, two_ports};

const PORTS: &str = "STILLPOINT_TEST_SPEED_PORTS";
/// Bytes of a body, and round trips of one turn.
const SIZES: [(&str, usize, usize); 2] = [("64 B", 64, 200), ("1.2 MB", 1_228_800, 20)];
const TURNS: usize = 10;

/// A host whose samples wake this thread.
fn woken(name: &str, endpoints: Endpoints) -> Arc<Host> {
    let me = std::thread::current();
    let mut settings = settings(name, endpoints, identity(), 1, 0);
    settings.arrived = Arc::new(move || me.unpark());
    Host::open(settings).unwrap()
}

/// zenoh alone: what arrives wakes this thread.
struct Bare {
    session: Session,
    waiting: Arc<Mutex<VecDeque<zenoh::bytes::ZBytes>>>,
    _subscriber: zenoh::pubsub::Subscriber<()>,
    to: &'static str,
}

impl Bare {
    fn open(listen: &str, connect: &str, from: &'static str, to: &'static str) -> Self {
        let config = format!(
            r#"{{ mode: "peer", listen: {{ endpoints: [{listen}] }},
                connect: {{ endpoints: [{connect}], exit_on_failure: false, retry: {{ period_init_ms: 100, period_max_ms: 200 }} }},
                scouting: {{ delay: 0, multicast: {{ enabled: false }}, gossip: {{ enabled: false }} }} }}"#
        );
        let session = zenoh::open(zenoh::Config::from_json5(&config).unwrap()).wait().unwrap();
        let waiting: Arc<Mutex<VecDeque<_>>> = Arc::default();
        let (queue, me) = (waiting.clone(), std::thread::current());
        let take = move |sample: zenoh::sample::Sample| {
            queue.lock().unwrap().push_back(sample.payload().clone());
            me.unpark();
        };
        let subscriber = session.declare_subscriber(from).callback(take).wait().unwrap();
        Self { session, waiting, _subscriber: subscriber, to }
    }

    /// The body made contiguous, as a program that uses it needs it.
    fn take(&self) -> Option<Vec<u8>> {
        self.waiting.lock().unwrap().pop_front().map(|bytes| bytes.to_bytes().into_owned())
    }

    fn put(&self, bytes: &[u8]) {
        self.session.put(self.to, bytes).congestion_control(CongestionControl::Drop).wait().unwrap();
    }
}

fn sample(bytes: usize) -> AlignedBytes {
    let header = Header { stamp: 0, origin: 0, sequence: 0, incarnation: 0, count: bytes as u32 };
    AlignedBytes::joined(header.as_bytes(), &vec![1; bytes])
}

fn send(sender: &mut dyn Sender, sample: &[u8]) {
    sender.send(Pieces::split(Datagram::KIND, sample).unwrap()).unwrap();
}

fn ends(host: &Arc<Host>, sends: &str, takes: &str, longest: usize) -> (Box<dyn Sender>, Box<dyn Receiver>) {
    let receiver = Remote::new(host, takes).open_receiver(&channel(longest)).unwrap();
    (Remote::new(host, sends).open_sender(&channel(longest)).unwrap(), receiver)
}

/// The other process: it sends back what it gets.
#[test]
#[ignore = "started by another test as a process of its own"]
fn echo_process() {
    let Ok(ports) = std::env::var(PORTS) else { return };
    let (port, bare) = ports.split_once(' ').unwrap();
    let host = woken("cluster", connecting(port.parse().unwrap()));
    let mut edges = SIZES.map(|(name, bytes, _)| (bytes, ends(&host, &format!("back {name}"), name, bytes)));
    let bare = Bare::open("", &format!("\"tcp/127.0.0.1:{bare}\""), "there", "back");
    let mut body = Vec::new();
    loop {
        let mut worked = false;
        for (_, (sender, receiver)) in &mut edges {
            while receiver.receive(&mut body).unwrap().is_some() {
                send(&mut **sender, &body);
                worked = true;
            }
        }
        while let Some(bytes) = bare.take() {
            bare.put(&bytes);
            worked = true;
        }
        if !worked {
            std::thread::park_timeout(Duration::from_millis(100));
        }
    }
}

fn until(mut arrived: impl FnMut() -> bool) -> bool {
    let begun = Instant::now();
    while !arrived() {
        if begun.elapsed() > Duration::from_secs(2) {
            return false;
        }
        std::thread::park_timeout(Duration::from_millis(100));
    }
    true
}

fn reported(what: &str, times: &mut [Duration]) -> f64 {
    times.sort();
    let at = |share: usize| times[times.len() * share / 100].as_secs_f64() * 1e6 / 2.0;
    eprintln!("{what}: p50 {:.0} us, p90 {:.0} us one way, {} round trips", at(50), at(90), times.len());
    at(50)
}

#[test]
#[ignore = "a measurement of half a minute: .ci/soak runs it"]
fn an_edge_beside_bare_zenoh() {
    let (port, other) = (two_ports(), two_ports());
    let host = woken("bedside", listening(port));
    let bare = Bare::open(&format!("\"tcp/127.0.0.1:{other}\""), "", "back", "there");
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["--ignored", "--exact", "speed::echo_process"])
        .env(PORTS, format!("{port} {other}"))
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    for (name, bytes, trips) in SIZES {
        let (mut sender, mut receiver) = ends(&host, name, &format!("back {name}"), bytes);
        eventually("the link is open", || {
            sender.state() == LinkState::Open && receiver.state() == LinkState::Open
        });
        eventually("zenoh is connected", || {
            bare.put(&[0; 8]);
            std::thread::park_timeout(Duration::from_millis(50));
            bare.take().is_some()
        });
        while until(|| bare.take().is_some()) {}
        let (mut edge, mut alone) = (Vec::new(), Vec::new());
        let mut body = Vec::new();
        let sample = sample(bytes);
        for _ in 0..TURNS {
            for _ in 0..trips {
                let begun = Instant::now();
                send(&mut *sender, &sample);
                if until(|| receiver.receive(&mut body).unwrap().is_some()) {
                    edge.push(begun.elapsed());
                }
            }
            for _ in 0..trips {
                let begun = Instant::now();
                bare.put(&sample[HEADER_SIZE..]);
                if until(|| bare.take().is_some()) {
                    alone.push(begun.elapsed());
                }
            }
        }
        let edge = reported(&format!("{name}, edge"), &mut edge);
        let alone = reported(&format!("{name}, bare zenoh"), &mut alone);
        eprintln!("{name}: {:.2} times", edge / alone);
    }
    let _ = child.kill();
    let _ = child.wait();
}
