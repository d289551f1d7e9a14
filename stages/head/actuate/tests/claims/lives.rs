//! The far end: numbers, lives and sessions, valves and beam.

use stillpoint_actuate::{
    Act, Clock, DatagramRefusal, FarEnd, Key, Message, Order, Receiver, Receives, Receiving, Safe, Session,
};

use super::sent::{bytes, key, order, session};

const MS: u64 = 1_000_000;

/// A receiver in session 0, at rest, number 0 having come at 0 ms.
fn entered() -> Receiver {
    let mut receiver = Receiver::new(key(), Receives::valves(6));
    receiver.receive(&bytes(&order(session(0), 0, 0, Order::Hold)), 0).unwrap();
    receiver
}

fn take(receiver: &mut Receiver, message: &Message, ms: u64) -> Option<DatagramRefusal> {
    receiver.receive(&bytes(message), ms * MS).err()
}

#[test]
fn repeated_reordered_and_foreign_datagrams_are_refused_and_counted() {
    let mut receiver = entered();
    for (sequence, refusal) in [
        (1, None),
        (1, Some(DatagramRefusal::Repeated)),
        (4, None),
        (3, Some(DatagramRefusal::Old)),
        (0, Some(DatagramRefusal::Old)),
        (5, None),
    ] {
        assert_eq!(take(&mut receiver, &order(session(0), sequence, 1, Order::Follow), 1), refusal);
    }
    let beam = Message { sequence: 6, stamp: MS, ..Message::resting(Receiving::Beam, session(0)) };
    assert_eq!(take(&mut receiver, &beam, 1), Some(DatagramRefusal::Recipient));
    let mut four = order(session(0), 6, 1, Order::Follow);
    (four.valves, four.duty[5]) = (4, 0.0);
    assert_eq!(take(&mut receiver, &four, 1), Some(DatagramRefusal::Valves));
    let other = Key::parse(&[b"01".repeat(16), b"02".repeat(16)].concat()).unwrap();
    let mut foreign = Receiver::new(other, Receives::valves(6));
    assert_eq!(take(&mut foreign, &order(session(0), 0, 0, Order::Hold), 0), Some(DatagramRefusal::Forged));
    let counts = receiver.counts();
    assert_eq!((counts.accepted, counts.missing, counts.sessions), (4, 2, 1));
    assert_eq!((counts.refused(DatagramRefusal::Repeated), counts.refused(DatagramRefusal::Old)), (1, 2));
    assert_eq!((counts.refused(DatagramRefusal::Recipient), counts.all_refused()), (1, 5));
}

#[test]
fn a_life_ends_sixty_ms_after_the_stamp_and_the_safe_state_holds() {
    let mut receiver = entered();
    assert_eq!(receiver.act(59 * MS), Act::Hold);
    assert!(receiver.is_alive(60 * MS - 1) && !receiver.is_alive(60 * MS));
    assert_eq!(receiver.act(60 * MS), Act::Vent);
    // It came 20 ms after it was made: its life is not longer for that.
    take(&mut receiver, &order(session(0), 1, 100, Order::Follow), 120);
    assert_eq!(receiver.ends(), Some(160 * MS));
    let hold = Message { safe: Safe::Hold, ..order(session(0), 2, 150, Order::Follow) };
    assert_eq!(take(&mut receiver, &hold, 150), None);
    assert_eq!(receiver.act(211 * MS), Act::Hold);
}

#[test]
fn what_was_held_back_on_the_way_or_is_of_the_future_is_refused() {
    let mut receiver = entered();
    assert_eq!(
        take(&mut receiver, &order(session(0), 1, 10, Order::Follow), 70),
        Some(DatagramRefusal::Late)
    );
    assert_eq!(
        take(&mut receiver, &order(session(0), 1, 80, Order::Follow), 70),
        Some(DatagramRefusal::Early)
    );
    assert_eq!(take(&mut receiver, &order(session(0), 1, 74, Order::Follow), 70), None);
    // A stamp a little ahead gives no longer life.
    assert_eq!(receiver.ends(), Some(130 * MS));
    // With a clock of its own a receiver sees none of this.
    let mut own = Receiver::new(key(), Receives { clock: Clock::Own, ..Receives::valves(6) });
    assert_eq!(take(&mut own, &order(session(0), 0, 5_000, Order::Hold), 0), None);
    assert_eq!(own.ends(), Some(60 * MS));
}

#[test]
fn a_session_is_entered_at_rest_after_the_life_of_the_last_one_and_only_by_a_later_one() {
    let mut receiver = entered();
    let new = session(30);
    assert_eq!(take(&mut receiver, &order(new, 0, 40, Order::Hold), 40), Some(DatagramRefusal::SecondSender));
    assert_eq!(take(&mut receiver, &order(new, 3, 60, Order::Follow), 60), Some(DatagramRefusal::InMotion));
    assert_eq!(take(&mut receiver, &order(new, 4, 60, Order::Vent), 60), None);
    assert_eq!(take(&mut receiver, &order(new, 5, 61, Order::Follow), 61), None);
    // The old process wakes up, now and after the new one is gone.
    for ms in [62, 500] {
        let woken = order(session(0), 9, ms, Order::Hold);
        assert_eq!(take(&mut receiver, &woken, ms), Some(DatagramRefusal::OldSession));
    }
    // Of one start, but another operator: no order between them.
    let twin = Session { nonce: 1, ..new };
    assert_eq!(
        take(&mut receiver, &order(twin, 0, 500, Order::Hold), 500),
        Some(DatagramRefusal::OldSession)
    );
    assert_eq!(receiver.counts().sessions, 2);
}

#[test]
fn a_recording_of_an_earlier_run_moves_nothing() {
    // The far end was started anew and knows no session; somebody plays back what was sent an hour ago.
    let mut receiver = Receiver::new(key(), Receives::valves(6));
    let now = 3_600_000;
    for (sequence, o) in [(0, Order::Hold), (1, Order::Follow), (2, Order::Follow)] {
        let recorded = order(session(0), sequence, 10 * sequence, o);
        assert_eq!(take(&mut receiver, &recorded, now + sequence), Some(DatagramRefusal::Late));
    }
    assert_eq!(receiver.act((now + 3) * MS), Act::Vent);
}

#[test]
fn duties_grow_from_zero_after_silence_and_in_a_new_session() {
    let mut receiver = entered();
    let duty = |receiver: &Receiver, ms: u64| match receiver.act(ms * MS) {
        Act::Follow(duty) => duty[0],
        act => panic!("{act:?}"),
    };
    take(&mut receiver, &order(session(0), 1, 50, Order::Follow), 50);
    assert_eq!(duty(&receiver, 50), 0.25);
    take(&mut receiver, &order(session(0), 2, 100, Order::Follow), 100);
    assert_eq!((duty(&receiver, 100), duty(&receiver, 130)), (0.5, 0.5));
    // Silence from 160 to 200 ms: the valves vented.
    assert_eq!(receiver.act(160 * MS), Act::Vent);
    take(&mut receiver, &order(session(0), 3, 200, Order::Follow), 200);
    assert_eq!((duty(&receiver, 200), duty(&receiver, 220)), (0.0, 0.1));
}

/// A far end whose valves follow and whose beam is on until 100 ms.
fn beaming() -> FarEnd {
    let mut far = FarEnd::new(&key(), Receives::valves(6));
    let lease = |sequence, order| Message {
        sequence,
        order,
        life: 100 * MS,
        ..Message::resting(Receiving::Beam, session(0))
    };
    for message in [
        order(session(0), 0, 0, Order::Hold),
        order(session(0), 1, 0, Order::Follow),
        lease(0, Order::Hold),
        lease(1, Order::Follow),
    ] {
        far.receive(&bytes(&message), 0).unwrap();
    }
    far
}

#[test]
fn silence_ends_the_beam_one_step_before_it_vents_though_the_lease_lives() {
    let mut far = beaming();
    assert!(far.step(59 * MS).beam);
    let first = far.step(60 * MS);
    assert_eq!((first.beam, first.valves), (false, Act::Hold));
    assert!(far.beam_receiver().is_alive(61 * MS));
    let second = far.step(61 * MS);
    assert_eq!((second.beam, second.valves), (false, Act::Vent));
}

#[test]
fn an_order_to_vent_ends_the_beam_though_nobody_ended_the_lease() {
    let mut far = beaming();
    assert!(far.step(MS).beam);
    far.receive(&bytes(&order(session(0), 2, 2, Order::Vent)), 2 * MS).unwrap();
    assert_eq!(far.step(2 * MS).valves, Act::Hold);
    let doing = far.step(3 * MS);
    assert_eq!((doing.beam, doing.valves), (false, Act::Vent));
}

#[test]
fn the_beam_is_off_without_a_lease_and_while_the_valves_hold() {
    let mut far = FarEnd::new(&key(), Receives::valves(6));
    assert_eq!(far.step(0).valves, Act::Vent);
    let lease = Message { order: Order::Follow, ..Message::resting(Receiving::Beam, session(0)) };
    assert_eq!(far.receive(&bytes(&lease), 0), Err(DatagramRefusal::InMotion));
    assert!(!far.step(MS).beam);
    let mut far = beaming();
    far.receive(&bytes(&order(session(0), 2, 2, Order::Hold)), 2 * MS).unwrap();
    assert!(!far.step(2 * MS).beam);
    assert_eq!(far.receive(b"noise", 3 * MS), Err(DatagramRefusal::TooShort));
    assert_eq!((far.valves().all_refused(), far.beam().accepted), (1, 2));
}
