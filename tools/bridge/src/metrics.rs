//! Figures of a worker and of a router as Prometheus text.

use std::cell::Cell;
use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::time::{Duration, Instant};

use stillpoint_http::FigureKind::{Counter, Gauge};
use stillpoint_http::{Figures, Metrics, MetricsError};
use stillpoint_pool::Worker;
use stillpoint_remote::{Beat, Member};

/// Interval at which figures are made.
const MADE: Duration = Duration::from_millis(500);
/// Time of silence after which another program no longer counts as a peer.
const GONE: Duration = Duration::from_secs(10);
/// The most names of peers that are remembered.
const MOST_PEERS: usize = 1024;

/// Figures that are served.
pub struct Served {
    metrics: Metrics,
    made: Cell<Option<Instant>>,
}

impl Served {
    /// At this address from now on. The address is printed.
    ///
    /// # Errors
    /// The address cannot be used.
    pub fn at(address: SocketAddr) -> Result<Self, MetricsError> {
        let (metrics, bound) = Metrics::serve(address)?;
        eprintln!("stillpoint-bridge: metrics at http://{bound}/metrics");
        Ok(Self { metrics, made: Cell::new(None) })
    }

    /// Takes new figures, twice a second at most.
    pub fn update(&self, make: impl FnOnce() -> Figures) {
        if self.made.get().is_none_or(|made| made.elapsed() >= MADE) {
            self.made.set(Some(Instant::now()));
            self.metrics.update(make());
        }
    }
}

/// What a worker exchanges with others.
#[derive(Default)]
pub struct Exchanged {
    received: (u64, u64),
    sent: (u64, u64),
    /// Messages that arrived and were pushed out before they were read.
    pub lost: u64,
    peers: BTreeMap<String, Instant>,
}

impl Exchanged {
    /// A message of this length arrived.
    pub fn receive(&mut self, from: &str, bytes: usize) {
        self.received = (self.received.0 + 1, self.received.1 + bytes as u64);
        if self.peers.len() >= MOST_PEERS {
            self.peers.retain(|_, last| last.elapsed() < GONE);
        }
        if self.peers.len() < MOST_PEERS || self.peers.contains_key(from) {
            self.peers.insert(from.to_owned(), Instant::now());
        }
    }

    /// A message of this length was sent.
    pub fn send(&mut self, bytes: usize) {
        self.sent = (self.sent.0 + 1, self.sent.1 + bytes as u64);
    }

    fn peers(&self) -> usize {
        self.peers.values().filter(|last| last.elapsed() < GONE).count()
    }
}

/// The figures of a worker at a time of its clock, ns.
pub fn of_worker(name: &str, (state, now): (&Worker, u64), exchanged: &Exchanged) -> Figures {
    let (hello, counts) = (state.hello(), state.counts());
    let mut figures = Figures::default();
    let labels = [("worker", name)];
    let build = [("worker", name), ("build", hello.build.as_str())];
    figures.family("worker_info", Gauge, "The build of the worker.").value(&build, 1.0);
    let (received, sent) = (exchanged.received, exchanged.sent);
    let rows = [
        ("worker_slots", Gauge, "Calls that are computed at the same time, at most.", u64::from(hello.slots)),
        ("worker_calls_running", Gauge, "Calls that are computed.", u64::from(hello.running)),
        (
            "worker_calls_waiting",
            Gauge,
            "Calls that wait for a slot or for their inputs.",
            u64::from(hello.waiting),
        ),
        (
            "worker_pool_calls",
            Gauge,
            "Calls in the whole pool without an answer, as those who ask say.",
            state.demand(now),
        ),
        ("worker_calls_answered_total", Counter, "Calls that were answered.", counts.answered),
        ("worker_calls_cached_total", Counter, "Calls whose answer was in the cache.", counts.known),
        ("worker_calls_failed_total", Counter, "Calls that failed.", counts.failed),
        (
            "worker_calls_refused_total",
            Counter,
            "Calls of another build, and messages that are not calls.",
            counts.refused,
        ),
        ("worker_calls_busy_total", Counter, "Calls for which there was no room.", counts.busy),
        ("worker_messages_received_total", Counter, "Messages that arrived.", received.0),
        ("worker_received_bytes_total", Counter, "Bytes of messages that arrived.", received.1),
        ("worker_messages_sent_total", Counter, "Messages that were sent.", sent.0),
        ("worker_sent_bytes_total", Counter, "Bytes of messages that were sent.", sent.1),
        ("worker_messages_lost_total", Counter, "Messages that newer ones pushed out.", exchanged.lost),
        ("worker_cache_bytes", Gauge, "Bytes in the cache.", hello.cache),
        ("worker_cache_limit_bytes", Gauge, "The most bytes of the cache.", hello.cache_most),
        ("worker_peers", Gauge, "Programs that sent a message in the last 10 s.", exchanged.peers() as u64),
    ];
    for (name, kind, about, value) in rows {
        figures.family(name, kind, about).value(&labels, value as f64);
    }
    figures
}

/// The figures of a router: of those who greet through it.
pub fn of_router(members: &[Member]) -> Figures {
    let mut figures = Figures::default();
    let present = members.iter().filter(|member| member.is_there());
    let version = [("version", env!("CARGO_PKG_VERSION"))];
    figures.family("router_info", Gauge, "The version of the router.").value(&version, 1.0);
    figures
        .family("router_peers", Gauge, "Hosts and workers that greeted in the last 2 s.")
        .value(&[], present.count() as f64);
    figures.family("peer_greetings_total", Counter, "Greetings of a host or a worker.");
    for member in members {
        figures.value(&[("peer", &member.name)], member.greetings as f64);
    }
    figures.family("peer_silent_seconds", Gauge, "Time since the last greeting.");
    for member in members {
        figures.value(&[("peer", &member.name)], member.silent.as_secs_f64());
    }
    let beats = || members.iter().filter_map(|member| member.beat.as_ref());
    figures.family("host_info", Gauge, "The version and the pipeline of a host.");
    for beat in beats() {
        let of = &beat.identity;
        figures.value(&[("host", &beat.host), ("version", &of.version), ("pipeline", &of.pipeline)], 1.0);
    }
    let about = "Samples that a host handed to the network.";
    let of_edges = |figures: &mut Figures, name: &str, about: &str, counts: fn(&Beat) -> Edges<'_>| {
        figures.family(name, Counter, about);
        for beat in beats() {
            for (edge, count) in counts(beat) {
                figures.value(&[("host", &beat.host), ("edge", edge)], count as f64);
            }
        }
    };
    of_edges(&mut figures, "edge_samples_put_total", about, |beat| {
        sums(beat.sends.iter().map(|end| (end.edge.as_str(), end.put)))
    });
    let about =
        "Samples that arrived at a host; the difference to those that were put is lost or on its path.";
    of_edges(&mut figures, "edge_samples_received_total", about, |beat| {
        sums(beat.takes.iter().map(|end| (end.edge.as_str(), end.received)))
    });
    let about = "Samples that arrived and were not valid.";
    of_edges(&mut figures, "edge_samples_refused_total", about, |beat| {
        sums(beat.takes.iter().map(|end| (end.edge.as_str(), end.refused)))
    });
    figures
}

/// Counts by edge.
type Edges<'a> = BTreeMap<&'a str, u64>;

/// One edge may have several ends, one after the other.
fn sums<'a>(ends: impl Iterator<Item = (&'a str, u64)>) -> Edges<'a> {
    let mut sums = Edges::new();
    ends.for_each(|(edge, count)| *sums.entry(edge).or_default() += count);
    sums
}

#[cfg(test)]
mod tests {
    use stillpoint_remote::{HostIdentity, Sends};

    use super::*;

    #[test]
    fn the_ends_of_an_edge_are_one_figure_and_a_host_that_is_silent_is_no_peer() {
        let end = |end, put| Sends { edge: "rig_depth".into(), channel: "Depth".into(), end, put };
        let beat = Beat {
            protocol: 1,
            host: "bedside".into(),
            incarnation: 1,
            number: 9,
            identity: HostIdentity {
                pipeline: "two".into(),
                version: "0.1.0".into(),
                ..HostIdentity::default()
            },
            at: 0,
            seen: Vec::new(),
            sends: vec![end(1, 30), end(2, 12)],
            takes: Vec::new(),
        };
        let silent = Duration::from_millis(2500);
        let member = Member { name: "bedside".into(), greetings: 9, silent, beat: Some(beat) };
        let text = of_router(&[member]).into_text();
        for line in [
            "stillpoint_router_peers 0",
            "stillpoint_peer_greetings_total{peer=\"bedside\"} 9",
            "stillpoint_peer_silent_seconds{peer=\"bedside\"} 2.5",
            "stillpoint_host_info{host=\"bedside\",version=\"0.1.0\",pipeline=\"two\"} 1",
            "stillpoint_edge_samples_put_total{host=\"bedside\",edge=\"rig_depth\"} 42",
        ] {
            assert!(text.lines().any(|l| l == line), "{line} is not in\n{text}");
        }
    }
}
