//! A slow link: bulk does not hold up small samples, and whatever is lost is counted.

use std::time::{Duration, Instant};

use stillpoint_remote::Endpoints;
use stillpoint_samples::{Datagram, Pieces, Sample};
use stillpoint_transport::LinkState;

use crate::common::{Pair, datagram, eventually, host, identity, link, listening, two_ports};
use crate::relay::Relay;

/// 10 Mbit/s, bytes a second.
const RATE: f64 = 1.25e6;

#[test]
#[ignore = "a measurement of eight seconds: .ci/soak runs it"]
fn small_samples_pass_beside_bulk_at_ten_megabit_a_second() {
    let (port, relayed) = (two_ports(), two_ports());
    let _relay = Relay::start(relayed, port, Some(RATE));
    let through = Endpoints { connect: vec![format!("tcp/127.0.0.1:{relayed}")], ..Endpoints::default() };
    let pair = Pair {
        sender: host("bedside", listening(port), identity()),
        receiver: host("cluster", through, identity()),
    };
    let (mut small, mut from_small) = link(&pair.edge("small"), 64);
    let (mut bulk, mut from_bulk) = link(&pair.edge("bulk"), 1 << 20);
    eventually("both links open", || small.state() == LinkState::Open && bulk.state() == LinkState::Open);
    let (mut sent_at, mut delays, mut bytes) = (Vec::new(), Vec::new(), Vec::new());
    let begun = Instant::now();
    let mut images = 0;
    while sent_at.len() < 600 {
        if begun.elapsed() >= Duration::from_millis(10) * sent_at.len() as u32 {
            datagram(&mut *small, sent_at.len() as u64, 64);
            sent_at.push(Instant::now());
            datagram(&mut *bulk, images, 1 << 20);
            images += 1;
        }
        while from_small.receive(&mut bytes).unwrap().is_some() {
            let number = Pieces::split(Datagram::KIND, &bytes).unwrap().header().sequence;
            delays.push(sent_at[number as usize].elapsed());
        }
        while from_bulk.receive(&mut bytes).unwrap().is_some() {}
        std::thread::sleep(Duration::from_micros(200));
    }
    eventually("the accounts balance", || {
        ["small", "bulk"].iter().all(|edge| {
            let (sent, taken) = (pair.sender.sent()[*edge], pair.receiver.taken()[*edge]);
            sent.put == taken.received + taken.refused + taken.lost + taken.missing && taken.missing == 0
        })
    });
    delays.sort();
    let (sent, taken) = (pair.sender.sent(), pair.receiver.taken());
    eprintln!(
        "small: {:?}\n       {:?}\nbulk:  {:?}\n       {:?}",
        sent["small"], taken["small"], sent["bulk"], taken["bulk"]
    );
    eprintln!(
        "small, one way: p50 {:?}, p99 {:?}",
        delays[delays.len() / 2],
        delays[delays.len() * 99 / 100]
    );
    assert_eq!(sent["small"].offered, 600);
    assert!(taken["bulk"].received >= 3, "bulk goes on: {:?}", taken["bulk"]);
}
