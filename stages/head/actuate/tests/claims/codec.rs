//! Messages become bytes and come back.

use proptest::prelude::*;
use stillpoint_actuate::datagram::receiving;
use stillpoint_actuate::{
    DatagramRefusal, EncodeError, LONGEST, Message, Order, Receiving, Safe, Session, VALVES, decode, encode,
};

use super::sent::{bytes, key, order, resealed, session};

prop_compose! {
    fn messages()(
        kind in 0..5u8,
        vents in any::<bool>(),
        started in any::<u64>(),
        nonce in any::<u64>(),
        sequence in any::<u64>(),
        stamp in any::<u64>(),
        life in 1..=1_000_000u64,
        reasons in any::<u32>(),
        valves in 0..=VALVES,
        duty in prop::array::uniform16(0.0..=1.0f32),
    ) -> Message {
        let (receiving, order) = match kind {
            0 => (Receiving::Valves, Order::Hold),
            1 => (Receiving::Valves, Order::Vent),
            2 => (Receiving::Valves, Order::Follow),
            3 => (Receiving::Beam, Order::Hold),
            _ => (Receiving::Beam, Order::Follow),
        };
        let is_beam = receiving == Receiving::Beam;
        let valves = if is_beam { 0 } else { valves };
        let follows = order == Order::Follow;
        Message {
            receiving,
            order,
            safe: if vents && !is_beam { Safe::Vent } else { Safe::Hold },
            session: Session { started, nonce },
            sequence,
            stamp,
            life: life * 1_000,
            reasons,
            valves,
            duty: std::array::from_fn(|i| if follows && i < valves { duty[i] } else { 0.0 }),
        }
    }
}

proptest! {
    #[test]
    fn every_message_comes_back_as_it_was(message in messages()) {
        let bytes = bytes(&message);
        prop_assert_eq!(decode(&bytes, &key()), Ok(message));
        prop_assert_eq!(receiving(&bytes), Some(message.receiving));
    }
}

#[test]
fn the_layout_is_that_of_the_docs() {
    let mut message = order(Session { started: 0x1122, nonce: 0x3344 }, 5, 0, Order::Follow);
    (message.stamp, message.reasons) = (0x5566, 0x0708_090a);
    let bytes = bytes(&message);
    assert_eq!(bytes.len(), 52 + 4 * 6 + 32);
    assert_eq!(&bytes[..8], b"SPDG\x01\x01\x02\x01");
    assert_eq!(&bytes[8..24], b"\x22\x11\0\0\0\0\0\0\x44\x33\0\0\0\0\0\0");
    assert_eq!(&bytes[24..40], b"\x05\0\0\0\0\0\0\0\x66\x55\0\0\0\0\0\0");
    assert_eq!(&bytes[40..52], b"\x60\xea\0\0\x0a\x09\x08\x07\x06\0\0\0");
    assert_eq!(bytes[52..56], 0.5f32.to_le_bytes());
    assert_eq!(bytes[76..], key().code(&bytes[..76]));
    assert_eq!((stillpoint_actuate::datagram::SHORTEST, LONGEST), (84, 148));
}

#[test]
fn what_no_receiver_takes_is_not_sent() {
    let fault = |change: fn(&mut Message)| {
        let mut message = order(session(0), 0, 0, Order::Follow);
        change(&mut message);
        encode(&message, &key(), &mut [0; LONGEST]).unwrap_err()
    };
    assert_eq!(fault(|m| m.valves = 17), EncodeError::Valves(17));
    assert!(matches!(fault(|m| m.duty[2] = f32::NAN), EncodeError::Duty { valve: 2, .. }));
    assert_eq!(fault(|m| m.duty[5] = 1.001), EncodeError::Duty { valve: 5, duty: 1.001 });
    assert_eq!(fault(|m| m.duty[0] = -0.0), EncodeError::Duty { valve: 0, duty: -0.0 });
    assert_eq!(fault(|m| m.life = 0), EncodeError::Life(0));
    assert_eq!(fault(|m| m.life = 1_500), EncodeError::Life(1_500));
    assert_eq!(fault(|m| m.life = 1_000_001_000), EncodeError::Life(1_000_001_000));
    assert_eq!(fault(|m| m.order = Order::Hold), EncodeError::Order);
    assert_eq!(fault(|m| m.duty[7] = 0.1), EncodeError::Order);
    assert_eq!(fault(|m| m.receiving = Receiving::Beam), EncodeError::Order);
}

#[test]
fn a_holder_of_the_key_that_makes_a_mistake_is_refused_by_its_reason() {
    let valid = bytes(&order(session(0), 0, 0, Order::Follow));
    let refused = |change: &dyn Fn(&mut [u8])| decode(&resealed(valid.clone(), change), &key());
    assert_eq!(
        refused(&|b| b[52..56].copy_from_slice(&f32::NAN.to_le_bytes())),
        Err(DatagramRefusal::NotFinite)
    );
    assert_eq!(
        refused(&|b| b[52..56].copy_from_slice(&f32::INFINITY.to_le_bytes())),
        Err(DatagramRefusal::NotFinite)
    );
    assert_eq!(
        refused(&|b| b[56..60].copy_from_slice(&1.5f32.to_le_bytes())),
        Err(DatagramRefusal::OutOfRange)
    );
    assert_eq!(
        refused(&|b| b[56..60].copy_from_slice(&(-0.1f32).to_le_bytes())),
        Err(DatagramRefusal::OutOfRange)
    );
    assert_eq!(
        refused(&|b| b[56..60].copy_from_slice(&(-0.0f32).to_le_bytes())),
        Err(DatagramRefusal::OutOfRange)
    );
    assert_eq!(refused(&|b| b[40..44].fill(0)), Err(DatagramRefusal::Life));
    assert_eq!(refused(&|b| b[40..44].fill(255)), Err(DatagramRefusal::Life));
    for byte in [5, 6, 7, 49, 50, 51] {
        assert_eq!(refused(&|b| b[byte] = 9), Err(DatagramRefusal::Malformed), "byte {byte}");
    }
    // An order to hold that carries duties, and a beam that vents.
    assert_eq!(refused(&|b| b[6] = 0), Err(DatagramRefusal::Malformed));
    assert_eq!(refused(&|b| b[5] = 2), Err(DatagramRefusal::Malformed));
    assert!(refused(&|_| {}).is_ok());
}
