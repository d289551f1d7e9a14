//! Broken datagrams: none is accepted, and nothing panics.

use proptest::prelude::*;
use stillpoint_actuate::{Act, DatagramRefusal, Order, Receiver, Receives, decode};

use super::sent::{bytes, key, order, session};

#[test]
fn every_flipped_bit_is_refused() {
    for message in [order(session(0), 3, 0, Order::Follow), order(session(0), 3, 0, Order::Hold)] {
        let valid = bytes(&message);
        for bit in 0..8 * valid.len() {
            let mut broken = valid.clone();
            broken[bit / 8] ^= 1 << (bit % 8);
            let refusal = decode(&broken, &key()).unwrap_err();
            let expected = match bit / 8 {
                0..4 => DatagramRefusal::Foreign,
                4 => DatagramRefusal::Version,
                48 => DatagramRefusal::Length,
                _ => DatagramRefusal::Forged,
            };
            assert_eq!(refusal, expected, "bit {bit}");
        }
    }
}

#[test]
fn every_cut_and_every_addition_is_refused() {
    let valid = bytes(&order(session(0), 0, 0, Order::Follow));
    for length in 0..valid.len() {
        let expected = if length < 84 { DatagramRefusal::TooShort } else { DatagramRefusal::Length };
        assert_eq!(decode(&valid[..length], &key()), Err(expected));
    }
    for more in 1..200 {
        let long = [&valid[..], &vec![0; more][..]].concat();
        let expected = if long.len() > 148 { DatagramRefusal::TooLong } else { DatagramRefusal::Length };
        assert_eq!(decode(&long, &key()), Err(expected));
    }
}

/// How a valid datagram is broken.
#[derive(Clone, Debug)]
enum Break {
    Noise(Vec<u8>),
    Bytes(Vec<(usize, u8)>),
    Cut(usize),
    Add(Vec<u8>),
    Splice(usize),
}

fn breaks() -> impl Strategy<Value = Break> {
    prop_oneof![
        prop::collection::vec(any::<u8>(), 0..400).prop_map(Break::Noise),
        prop::collection::vec((0..108usize, 1..=255u8), 1..6).prop_map(Break::Bytes),
        (0..108usize).prop_map(Break::Cut),
        prop::collection::vec(any::<u8>(), 1..1500).prop_map(Break::Add),
        (1..107usize).prop_map(Break::Splice),
    ]
}

proptest! {
    #[test]
    fn no_broken_datagram_is_accepted_or_changes_anything(how in breaks(), sequence in 2..1_000u64) {
        let mut receiver = Receiver::new(key(), Receives::valves(6));
        receiver.receive(&bytes(&order(session(0), 0, 0, Order::Hold)), 0).unwrap();
        receiver.receive(&bytes(&order(session(0), 1, 1, Order::Follow)), 1_000_000).unwrap();
        let before = receiver.act(2_000_000);
        let valid = bytes(&order(session(0), sequence, 2, Order::Follow));
        let mut broken = valid.clone();
        match how {
            Break::Noise(noise) => broken = noise,
            Break::Bytes(changes) => changes.iter().for_each(|(at, by)| broken[*at] ^= by),
            Break::Cut(length) => broken.truncate(length),
            Break::Add(more) => broken.extend(more),
            // The front of one valid datagram with the rest of another.
            Break::Splice(at) => {
                let other = bytes(&order(session(7), sequence + 1, 3, Order::Vent));
                broken = [&valid[..at], &other[at..]].concat();
            }
        }
        prop_assume!(broken != valid);
        prop_assert!(receiver.receive(&broken, 2_000_000).is_err());
        prop_assert_eq!(receiver.act(2_000_000), before);
        prop_assert!(matches!(before, Act::Follow(_)));
        prop_assert_eq!((receiver.counts().accepted, receiver.counts().all_refused()), (2, 1));
        // What is whole still passes.
        prop_assert!(receiver.receive(&valid, 2_000_000).is_ok());
    }
}
