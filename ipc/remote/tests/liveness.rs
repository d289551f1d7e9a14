//! Peers that are killed, stopped or cut off are noticed, and come back without a flood.

use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use stillpoint_remote::{Endpoints, Remote};
use stillpoint_transport::{LinkState, Receiver, Sender, Transport};

use crate::common::{channel, connecting, eventually, host, identity, listening, send, two_ports};
use crate::relay::Relay;

const PORT: &str = "STILLPOINT_TEST_PORT";

/// The body of the other process: it takes samples of one edge, and sends on another, until it is killed.
#[test]
#[ignore = "started by other tests as a process of its own"]
fn peer_process() {
    let Ok(port) = std::env::var(PORT) else { return };
    let endpoints = connecting(port.parse().unwrap());
    let host = host("cluster", endpoints, identity());
    let (mut sender, mut receiver) = ends(&host, "back", "pose");
    let (mut next, mut bytes) = (0, Vec::new());
    loop {
        send(&mut *sender, &mut next);
        while receiver.receive(&mut bytes).unwrap().is_some() {}
        std::thread::sleep(Duration::from_millis(1));
    }
}

fn ends(
    host: &Arc<stillpoint_remote::Host>,
    sends: &str,
    takes: &str,
) -> (Box<dyn Sender>, Box<dyn Receiver>) {
    let receiver = Remote::new(host, takes).open_receiver(&channel(64)).unwrap();
    (Remote::new(host, sends).open_sender(&channel(64)).unwrap(), receiver)
}

struct Peer(Child);

impl Peer {
    fn start(port: u16) -> Self {
        let process = Command::new(std::env::current_exe().unwrap())
            .args(["--ignored", "--exact", "liveness::peer_process"])
            .env(PORT, port.to_string())
            .stdout(Stdio::null())
            .spawn();
        Self(process.unwrap())
    }

    fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.0), signal).unwrap();
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Waits until samples pass in both directions.
fn until_open(sender: &mut dyn Sender, receiver: &mut dyn Receiver, next: &mut u64) {
    let mut bytes = Vec::new();
    while receiver.receive(&mut bytes).unwrap().is_some() {}
    eventually("samples pass", || {
        send(sender, next);
        sender.state() == LinkState::Open && receiver.receive(&mut bytes).unwrap().is_some()
    });
}

/// Waits until both ends notice that the peer is gone. Gives how long that took.
fn until_gone(sender: &dyn Sender, receiver: &dyn Receiver) -> Duration {
    let begun = Instant::now();
    eventually("the peer's silence is noticed", || {
        sender.state() == LinkState::Waiting && receiver.state() == LinkState::Waiting
    });
    begun.elapsed()
}

#[test]
fn a_peer_that_is_stopped_or_killed_is_noticed_and_comes_back_without_a_flood() {
    let port = two_ports();
    let host = host("bedside", listening(port), identity());
    let (mut sender, mut receiver) = ends(&host, "pose", "back");
    let mut next = 0;
    let mut peer = Peer::start(port);
    until_open(&mut *sender, &mut *receiver, &mut next);

    peer.signal(Signal::STOP);
    // The limit itself is no test: the machine may be busy. It is printed, and documented.
    eprintln!("stopped: noticed after {:?}", until_gone(&*sender, &*receiver));
    let before = host.sent()["pose"];
    (0..500).for_each(|_| send(&mut *sender, &mut next));
    let after = host.sent()["pose"];
    assert_eq!((after.put, after.waiting), (before.put, 0), "nothing piles up for a peer that is gone");
    assert_eq!(after.unheard, before.unheard + 500);
    peer.signal(Signal::CONT);
    until_open(&mut *sender, &mut *receiver, &mut next);

    peer.signal(Signal::KILL);
    eprintln!("killed: noticed after {:?}", until_gone(&*sender, &*receiver));
    drop(peer);
    peer = Peer::start(port);
    until_open(&mut *sender, &mut *receiver, &mut next);
    let taken = host.taken()["back"];
    assert!(taken.received > 0 && taken.refused == 0, "{taken:?}");
    drop(peer);
}

#[test]
fn a_link_that_is_cut_without_being_closed_is_noticed_on_both_sides_and_heals() {
    let (port, relayed) = (two_ports(), two_ports());
    let relay = Relay::start(relayed, port, None);
    let bedside = host("bedside", listening(port), identity());
    let through = Endpoints { connect: vec![format!("tcp/127.0.0.1:{relayed}")], ..Endpoints::default() };
    let cluster = host("cluster", through, identity());
    let (mut sender, _back) = ends(&bedside, "pose", "back");
    let (_there, mut receiver) = ends(&cluster, "back", "pose");
    let mut next = 0;
    until_open(&mut *sender, &mut *receiver, &mut next);
    relay.cut.store(true, Ordering::Relaxed);
    eprintln!("cut: noticed after {:?}", until_gone(&*sender, &*receiver));
    relay.cut.store(false, Ordering::Relaxed);
    until_open(&mut *sender, &mut *receiver, &mut next);
    for (host, peer) in [(bedside, "cluster"), (cluster, "bedside")] {
        let mut events = Vec::new();
        // A sample may arrive before the beat that shows that the peer is back.
        eventually("the peer is here, silent, and here again", || {
            events.extend(host.events());
            let count = |what: &str| {
                events.iter().filter(|e| e.text.starts_with(&format!("host `{peer}` is {what}"))).count()
            };
            count("here") >= 2 && count("silent") >= 1
        });
    }
}
