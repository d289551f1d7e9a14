//! The transport between hosts, over real zenoh sessions on loopback TCP: the conformance body, the accounts of lost
//! samples, peers that are killed, stopped or cut off, and hosts that do not run the same.

#![allow(clippy::unwrap_used)]

mod common;
mod foreign;
mod liveness;
mod python;
mod questions;
mod relay;
mod ros2;
mod slow;
mod speed;
mod tls;

use std::sync::Arc;

use common::{Pair, datagram, eventually, host, identity, link, send, two_ports};
use stillpoint_remote::{Endpoints, Host, HostIdentity, PeerState, Remote, RemoteError, Router};
use stillpoint_samples::{Datagram, DepthImage, HEADER_SIZE, Pieces, Sample};
use stillpoint_transport::conformance::conforms;
use stillpoint_transport::{Channel, LinkState, Transport};

#[test]
fn it_conforms() {
    // The hosts stay: each claim has an edge of its own.
    let pair = Pair::direct();
    let next = std::sync::atomic::AtomicU32::new(0);
    conforms(&|| {
        let number = next.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        Box::new(pair.edge(&format!("edge{number}")))
    });
}

#[test]
fn samples_pass_through_a_router_and_after_its_restart() {
    let port = two_ports();
    let endpoint = || vec![format!("tcp/127.0.0.1:{port}")];
    let to_router = || Endpoints { router: endpoint(), ..Endpoints::default() };
    let early = Host::open(common::settings("bedside", to_router(), identity(), 1, 0)).err().unwrap();
    assert!(early.to_string().contains(&endpoint()[0]), "{early}");
    let router = Router::open("stillpoint-test", endpoint(), None).unwrap();
    let pair = Pair {
        sender: host("bedside", to_router(), identity()),
        receiver: host("cluster", to_router(), identity()),
    };
    let (mut sender, mut receiver) = link(&pair.edge("pose"), 64);
    let mut next = 0;
    eventually("a sample passes", || {
        send(&mut *sender, &mut next);
        receiver.receive(&mut Vec::new()).unwrap().is_some()
    });
    router.close();
    drop(router);
    eventually("the sender notices", || sender.state() == LinkState::Waiting);
    let _router = Router::open("stillpoint-test", endpoint(), None).unwrap();
    eventually("samples pass again", || {
        send(&mut *sender, &mut next);
        receiver.receive(&mut Vec::new()).unwrap().is_some()
    });
    balances(&pair, "pose");
}

/// Waits until both accounts of an edge agree on every sample.
fn balances(pair: &Pair, edge: &str) {
    eventually("the accounts balance", || {
        let (sent, taken) = (pair.sender.sent()[edge], pair.receiver.taken()[edge]);
        let known = taken.received + taken.refused + taken.lost + taken.missing;
        assert_eq!(sent.offered, sent.replaced + sent.unheard + sent.put + sent.waiting, "{sent:?}");
        sent.waiting == 0 && sent.put == known
    });
}

#[test]
fn each_sample_of_bursts_small_and_bulk_is_accounted_for_on_both_sides() {
    let pair = Pair::direct();
    for (edge, bytes) in [("small", 64), ("bulk", 400_000)] {
        let (mut sender, mut receiver) = link(&pair.edge(edge), bytes);
        eventually("the link opens", || sender.state() == LinkState::Open);
        let mut next = 0;
        for _ in 0..3_000_000 / bytes.max(1_000) {
            datagram(&mut *sender, next, bytes);
            next += 1;
        }
        let mut last = None;
        let mut bytes = Vec::new();
        eventually("the newest sample arrives", || {
            while receiver.receive(&mut bytes).unwrap().is_some() {
                let number = Pieces::split(Datagram::KIND, &bytes).unwrap().header().sequence;
                assert!(last < Some(number), "in order");
                last = Some(number);
            }
            last == Some(next - 1)
        });
        balances(&pair, edge);
    }
}

#[test]
fn hosts_that_do_not_run_the_same_exchange_nothing_and_say_what_differs() {
    let port = two_ports();
    let other = HostIdentity { hash: "other".into(), version: "0.0.9".into(), ..identity() };
    let pair = Pair::of(host("bedside", common::listening(port), identity()), port, other);
    let (mut sender, mut receiver) = link(&pair.edge("pose"), 64);
    let mut next = 0;
    eventually("both ends are refused", || {
        send(&mut *sender, &mut next);
        let of = |state: LinkState, here: &str, there: &str| match state {
            LinkState::Refused(refusal) => {
                refusal.to_string().contains(&format!("`{here}` here and `{there}` there"))
            }
            _ => false,
        };
        of(sender.state(), "1", "other") && of(receiver.state(), "other", "1")
    });
    assert_eq!(receiver.receive(&mut Vec::new()), Ok(None));
    let report = &pair.sender.peers()[0];
    let PeerState::Refused(reasons) = &report.state else { panic!("{report:?}") };
    assert!(reasons[0].contains("hash") && reasons[1].contains("`0.0.9` there"), "{reasons:?}");
    assert_eq!(pair.sender.sent()["pose"].put, 0);
}

#[test]
fn any_type_of_sample_passes_with_its_body_and_the_clocks_are_compared() {
    // The host that connects begins before the one that listens.
    let port = two_ports();
    let receiver = host("cluster", common::connecting(port), identity());
    let pair = Pair { sender: host("bedside", common::listening(port), identity()), receiver };
    let channel = Channel { kind: DepthImage::KIND, frame: Some("camera".into()), capacity: 640 * 480 };
    let edge = pair.edge("camera.depth");
    let mut receiver = edge.open_receiver(&channel).unwrap();
    let mut sender = edge.open_sender(&channel).unwrap();
    let mut image = vec![7; DepthImage::KIND.meta_size() + 640 * 480 * 2];
    let end = DepthImage::KIND.meta_size();
    image[HEADER_SIZE - 4..HEADER_SIZE].copy_from_slice(&(640_u32 * 480).to_le_bytes());
    image[end - 4..end].copy_from_slice(&(640_u32 * 480).to_le_bytes());
    let mut bytes = Vec::new();
    eventually("the image passes", || {
        sender.send(Pieces::split(DepthImage::KIND, &image).unwrap()).unwrap();
        receiver.receive(&mut bytes).unwrap().is_some()
    });
    assert_eq!(bytes, image);
    // The clock of the sender is 3 s ahead: see `Pair`.
    let offset = common::retry(|| pair.receiver.offset_of("camera.depth"));
    assert!((offset.offset - 3_000_000_000).abs() <= offset.uncertainty, "{offset:?}");
    assert!(offset.uncertainty < 1_000_000_000, "{offset:?}");
}

#[test]
fn a_port_in_use_and_a_wrong_endpoint_are_named() {
    let port = two_ports();
    let _host = host("bedside", common::listening(port), identity());
    let open = |endpoint: String| {
        let endpoints = Endpoints { listen: vec![endpoint], ..Endpoints::default() };
        Host::open(common::settings("other", endpoints, identity(), 1, 0)).err().unwrap()
    };
    let error = open(format!("tcp/127.0.0.1:{port}"));
    assert!(
        matches!(error, RemoteError::Session { .. }) && error.to_string().contains(&port.to_string()),
        "{error}"
    );
    assert!(error.to_string().contains("the ports are free"), "{error}");
    assert!(matches!(open("127.0.0.1:7".into()), RemoteError::Endpoint(_)));
    // Nobody listens where it connects to: no port of this machine is in the way.
    let absent = Endpoints { router: vec![format!("tcp/127.0.0.1:{}", two_ports())], ..Endpoints::default() };
    let error = Host::open(common::settings("other", absent, identity(), 1, 0)).err().unwrap();
    assert!(error.to_string().contains("a program of stillpoint listens there"), "{error}");
}

#[test]
fn a_new_life_of_a_host_takes_the_place_of_the_old_one_and_the_tail_is_counted() {
    let port = two_ports();
    let mut pair = Pair::of(host("bedside", common::listening(port), identity()), port, identity());
    let mut receiver = pair.edge("pose").open_receiver(&common::channel(64)).unwrap();
    let mut put = 0;
    for life in 2..4 {
        let mut sender = Remote::new(&pair.sender, "pose").open_sender(&common::channel(64)).unwrap();
        let mut next = 0;
        eventually("a sample of this life passes, and all are accounted for", || {
            send(&mut *sender, &mut next);
            while receiver.receive(&mut Vec::new()).unwrap().is_some() {}
            let (sent, taken) = (pair.sender.sent()["pose"], pair.receiver.taken()["pose"]);
            sent.put > 0
                && sent.waiting == 0
                && taken.received + taken.refused + taken.lost + taken.missing == put + sent.put
        });
        put += pair.sender.sent()["pose"].put;
        drop(sender);
        let settings =
            || common::settings("bedside", common::listening(port), identity(), life, 3_000_000_000);
        drop(std::mem::replace(&mut pair.sender, host("stand-in", Endpoints::default(), identity())));
        pair.sender = common::retry(|| Host::open(settings()).ok());
    }
    let taken = pair.receiver.taken()["pose"];
    assert_eq!(taken.strange, 0, "{taken:?}");
}

#[test]
fn a_host_without_peers_waits_and_loses_nothing_that_it_does_not_count() {
    let host = host("bedside", common::listening(two_ports()), identity());
    let mut sender = Remote::new(&Arc::clone(&host), "pose").open_sender(&common::channel(64)).unwrap();
    let mut next = 0;
    (0..100).for_each(|_| send(&mut *sender, &mut next));
    assert_eq!(sender.state(), LinkState::Waiting);
    let sent = host.sent()["pose"];
    assert_eq!((sent.offered, sent.unheard, sent.put), (100, 100, 0));
}

#[test]
fn a_receiver_that_begins_later_does_not_count_what_came_before() {
    const FIRST: u64 = 500;
    let pair = Pair::direct();
    let (mut sender, mut receiver) = link(&pair.edge("pose"), 64);
    let (mut next, mut bytes) = (0, Vec::new());
    eventually("many samples pass", || {
        send(&mut *sender, &mut next);
        while receiver.receive(&mut bytes).unwrap().is_some() {}
        pair.receiver.taken()["pose"].received >= FIRST
    });
    drop(receiver);
    eventually("the sender notices", || sender.state() == LinkState::Waiting);
    let mut receiver = pair.edge("pose").open_receiver(&common::channel(64)).unwrap();
    eventually("a sample passes", || {
        send(&mut *sender, &mut next);
        receiver.receive(&mut bytes).unwrap().is_some()
    });
    let (sent, taken) = (pair.sender.sent()["pose"], pair.receiver.taken()["pose"]);
    // What was put since the last beat is not known to be of the receiver before.
    let of_both = taken.received + taken.refused + taken.lost + taken.missing;
    assert!(of_both + FIRST / 2 < sent.put, "{sent:?} {taken:?}");
}
