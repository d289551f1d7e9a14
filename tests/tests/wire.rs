//! A far end at a real socket: what is old, repeated, reordered, corrupted or foreign is refused, counted by its reason,
//! and moves nothing.

use std::net::UdpSocket;
use std::sync::atomic::{AtomicBool, Ordering};

use serde_json::Value;
use stillpoint_actuate::{Key, LONGEST, Message, Order, Receiving, Safe, Session, encode};
use stillpoint_pipeline::clock::realtime;

use crate::bench::{Bench, on_free_ports, text, wait_for};

const PIPELINE: &str = include_str!("pipelines/bedside.yaml");
const KEY: &[u8] = include_bytes!("../../examples/data/rig.key");
const SECOND: u64 = 1_000_000_000;
const VENTING: u64 = 1;
/// The longest life that an order can have: nothing here dies on its way.
const LIFE: u64 = SECOND;
/// How often each is tried: an order that a busy machine hands over after its life is refused for that.
const ROUNDS: u64 = 3;

/// The bedside at ports that nobody uses, and the address of its valves.
fn bedside(bench: &Bench) -> (std::path::PathBuf, String) {
    let yaml = on_free_ports(PIPELINE);
    let line = yaml.lines().find(|line| line.contains("pen.letter: { udp:")).unwrap();
    let address = line.split("udp: ").nth(1).unwrap().split(',').next().unwrap().to_owned();
    std::fs::create_dir(bench.path("data")).unwrap();
    std::fs::write(bench.path("data/rig.key"), KEY).unwrap();
    std::fs::write(bench.path("bedside.yaml"), yaml).unwrap();
    (bench.path("bedside.yaml"), address)
}

/// An order to the six valves, made now.
fn order(session: Session, sequence: u64, order: Order) -> Message {
    let mut message = Message {
        sequence,
        order,
        safe: Safe::Vent,
        stamp: realtime(),
        life: LIFE,
        valves: 6,
        ..Message::resting(Receiving::Valves, session)
    };
    if order == Order::Follow {
        // What nobody may do: every valve wide open.
        message.duty[..6].fill(1.0);
    }
    message
}

fn sealed(message: &Message, key: &Key) -> Vec<u8> {
    let mut bytes = [0; LONGEST];
    let length = encode(message, key, &mut bytes).unwrap();
    bytes[..length].to_vec()
}

/// A datagram of a holder of the key that says what no sender of this project would say.
fn resealed(mut bytes: Vec<u8>, key: &Key, change: impl FnOnce(&mut [u8])) -> Vec<u8> {
    let end = bytes.len() - 32;
    change(&mut bytes[..end]);
    let code = key.code(&bytes[..end]);
    bytes[end..].copy_from_slice(&code);
    bytes
}

/// Datagrams behind a live order of number `sequence`, each with the reason for which it is refused.
fn hostile(key: &Key, session: Session, sequence: u64, last: &[u8]) -> Vec<(&'static str, Vec<u8>)> {
    let stranger = Key::parse(&b"f".repeat(63).into_iter().chain(*b"e").collect::<Vec<u8>>()).unwrap();
    let follow = order(session, sequence + 1, Order::Follow);
    let good = sealed(&follow, key);
    let with = |change: &dyn Fn(&mut [u8])| resealed(good.clone(), key, change);
    let mut flipped = good.clone();
    flipped[60] ^= 1;
    let mut version = good.clone();
    version[4] = 2;
    let at = |stamp: u64| {
        let mut other = follow;
        other.stamp = stamp;
        sealed(&other, key)
    };
    let of = |started: u64, o: Order| sealed(&order(Session { started, nonce: 7 }, 0, o), key);
    let four = Message { valves: 4, duty: std::array::from_fn(|i| if i < 4 { 1.0 } else { 0.0 }), ..follow };
    vec![
        ("repeated", last.to_vec()),
        ("old", sealed(&order(session, sequence - 1, Order::Follow), key)),
        ("forged", flipped),
        ("forged", sealed(&follow, &stranger)),
        ("foreign", vec![0x5a; 108]),
        ("too_short", b"vent!".to_vec()),
        ("length", good[..good.len() - 4].to_vec()),
        ("version", version),
        ("late", at(realtime() - 3600 * SECOND)),
        ("early", at(realtime() + 3600 * SECOND)),
        ("valves", sealed(&four, key)),
        ("old_session", of(session.started - 1, Order::Hold)),
        ("second_sender", of(session.started + 1, Order::Follow)),
        ("not_finite", with(&|b| b[52..56].copy_from_slice(&f32::NAN.to_le_bytes()))),
        ("out_of_range", with(&|b| b[52..56].copy_from_slice(&1.5f32.to_le_bytes()))),
        ("life", with(&|b| b[40..44].fill(0))),
        ("malformed", with(&|b| b[6] = 9)),
    ]
}

#[test]
fn what_is_not_in_order_is_refused_by_its_reason_and_moves_nothing() {
    let bench = Bench::new();
    let (file, address) = bedside(&bench);
    let rig = bench.start(&["rig", text(&file), "--json", "--record", "s"]);
    let far = || -> Option<Value> {
        let done = bench.call(&["echo", "--json", "far.state", "--count", "1"]);
        let sample: Value = serde_json::from_str(done.out.lines().next()?).ok()?;
        Some(sample["elements"][0].clone())
    };
    wait_for("the far end", far);
    let key = Key::parse(KEY).unwrap();
    // Each from a port of its own: of one sender no more than 16 may wait.
    let send = |bytes: &[u8]| {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        assert_eq!(socket.send_to(bytes, &address).unwrap(), bytes.len());
    };
    let session = Session { started: realtime(), nonce: 42 };
    let mut sent = std::collections::BTreeMap::new();
    for round in 0..ROUNDS {
        // An order at rest, which lives while the others come. A number is left out before each.
        let sequence = 2 * round + 2;
        let good = sealed(&order(session, sequence, Order::Hold), &key);
        send(&good);
        for (reason, bytes) in hostile(&key, session, sequence, &good) {
            send(&bytes);
            *sent.entry(reason).or_insert(0_u64) += 1;
        }
        let all = round + 1 + sent.values().sum::<u64>();
        wait_for("all of them", || {
            let far = far()?;
            (far["accepted"].as_u64()? + far["refused"].as_u64()? == all).then_some(())
        });
    }
    // Nobody sends any more: the order that lived says what is safe.
    wait_for("the vent", || far().filter(|f| f["doing"] == VENTING));
    let report = rig.stop().good();
    assert_eq!(report["balanced"], true, "{}", report["ledger"]);
    let session = report["session"].as_str().unwrap();
    let echo = |topic: &str| -> Vec<Value> {
        let done = bench.call(&["echo", "--json", topic, "--session", session]);
        done.out.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    };
    let reported =
        bench.call(&["report", session, "--json"]).good()["sections"]["diagnostics"]["figures"].clone();
    let topics = reported["topics"].as_array().unwrap();
    let counted = topics.iter().find(|t| t["topic"] == "far.diagnostics").unwrap()["metrics"].clone();
    let count = |reason: &str| {
        let all = counted.as_array().unwrap();
        all.iter().find(|m| m["name"] == reason).unwrap()["last"].as_f64().unwrap() as u64
    };
    // What a busy machine hands over too late is refused, too, and then for that; all rounds are not.
    for (reason, sent) in &sent {
        let found = count(reason);
        assert!(found >= 1 && (found <= *sent || *reason == "late"), "{reason}: {found} of {sent}");
    }
    let last = echo("far.state").pop().unwrap()["elements"][0].clone();
    let accepted = last["accepted"].as_u64().unwrap();
    assert!((1..=ROUNDS).contains(&accepted), "{last}");
    assert_eq!((&last["beam"], &last["refused_beam"]), (&0.into(), &0.into()));
    // Not one inlet was ever opened.
    for state in echo("rig.state") {
        let opening = state["elements"][0]["opening"].as_array().unwrap().clone();
        assert!((0..3).all(|b| opening[2 * b] == 0.0), "{state}");
    }
    let replay = bench.call(&["replay", session, "--json"]).good();
    assert_eq!(replay["identical_all"], true);
}

/// Sends these bytes from four ports of this machine, 40 in a millisecond, until `enough` holds.
fn flood(address: &str, bytes: &[u8], enough: impl Fn() -> bool) {
    let sockets: Vec<UdpSocket> = (0..4).map(|_| UdpSocket::bind("127.0.0.1:0").unwrap()).collect();
    let is_over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            while !is_over.load(Ordering::Relaxed) {
                for i in 0..40 {
                    // What the kernel has no room for is lost, as on a wire.
                    let _ = sockets[i % 4].send_to(bytes, address);
                }
                std::thread::sleep(std::time::Duration::from_millis(1));
            }
        });
        wait_for("enough of the flood", || enough().then_some(()));
        is_over.store(true, Ordering::Relaxed);
    });
}

#[test]
fn noise_at_the_port_of_a_far_end_becomes_no_sample_and_a_flood_of_datagrams_costs_no_recording() {
    let bench = Bench::new();
    let (file, _) = bedside(&bench);
    let yaml = std::fs::read_to_string(&file).unwrap();
    let line = yaml.lines().find(|line| line.contains("far.acknowledgement: { udp:")).unwrap();
    let address = line.split("udp: ").nth(1).unwrap().split(',').next().unwrap();
    let run = bench.start(&["run", text(&file), "--host", "main", "--json", "--record", "s"]);
    let counted = |name: &str| -> Option<f64> {
        let done = bench.call(&["echo", "--json", "far_acknowledgement.diagnostics", "--count", "1"]);
        let sample: Value = serde_json::from_str(done.out.lines().next()?).ok()?;
        let metrics = sample["elements"].as_array()?.clone();
        metrics.iter().find(|m| m["name"] == name)?["value"].as_f64()
    };
    // Not from a far end: another beginning, too short, too long.
    for noise in [&[0x5a; 120][..], b"SPDA", &[b'S'; 900]] {
        let first = std::cell::Cell::new(None);
        flood(address, noise, || {
            let Some(now) = counted("foreign") else { return false };
            let start = first.get().unwrap_or(now);
            first.set(Some(start));
            now > start + 300.0
        });
    }
    // From one that looks like a far end, much faster than any sends.
    let mut alike = b"SPDA".to_vec();
    alike.resize(140, 7);
    flood(address, &alike, || counted("too_many_127.0.0.1").is_some_and(|now| now > 3000.0));
    let report = run.stop().good();
    assert_eq!((&report["balanced"], &report["complete"]), (&true.into(), &true.into()), "{report}");
    let session = report["session"].as_str().unwrap();
    let kept = bench.call(&["echo", "--json", "far_acknowledgement.datagram", "--session", session]);
    let is_alike = |line: &str| {
        let sample: Value = serde_json::from_str(line).unwrap();
        sample["count"] == 140 && sample["elements"][4] == 7
    };
    assert!(kept.out.lines().count() > 0 && kept.out.lines().all(is_alike), "no other became a sample");
}
