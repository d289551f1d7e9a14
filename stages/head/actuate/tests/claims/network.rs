//! A network that loses, repeats, delays and reorders the datagrams of several senders.

use proptest::prelude::*;
use stillpoint_actuate::{Act, Order, Receiver, Receives};

use super::sent::{bytes, key, order, session};

/// A datagram of one of three senders, and when it arrives after it was made, ms.
#[derive(Clone, Debug)]
struct Sent {
    sender: u64,
    order: Order,
    /// Time since the last of any sender, ms.
    after: u64,
    delay: u64,
    /// How often it arrives.
    copies: usize,
}

fn sent() -> impl Strategy<Value = Sent> {
    let order = prop_oneof![4 => Just(Order::Follow), 1 => Just(Order::Hold), 1 => Just(Order::Vent)];
    // Mostly the first; now and then the others, for a while or not at all.
    let sender = prop_oneof![6 => Just(0u64), 2 => Just(1), 1 => Just(2)];
    let after = prop_oneof![20 => 1..15u64, 1 => 50..200u64];
    let delay = prop_oneof![10 => 0..5u64, 2 => 5..90u64];
    (sender, order, after, delay, 0..3usize).prop_map(|(sender, order, after, delay, copies)| Sent {
        sender,
        order,
        after,
        delay,
        copies,
    })
}

proptest! {
    #[test]
    fn what_is_accepted_is_of_one_session_at_a_time_in_order_and_alive(
        all in prop::collection::vec(sent(), 1..200),
    ) {
        let (mut now, mut arriving) = (0, Vec::new());
        for (number, sent) in all.iter().enumerate() {
            now += sent.after;
            let message = order(session(sent.sender), number as u64, now, sent.order);
            for copy in 0..sent.copies {
                arriving.push((now + sent.delay + 7 * copy as u64, message));
            }
        }
        arriving.sort_by_key(|(at, _)| *at);
        let mut receiver = Receiver::new(key(), Receives::valves(6));
        let mut last: Option<(u64, u64)> = None;
        for (ms, message) in &arriving {
            let at = ms * 1_000_000;
            let (before, ends) = (receiver.act(at), receiver.ends());
            match receiver.receive(&bytes(message), at) {
                Ok(_) => {
                    let place = (message.session.started, message.sequence);
                    prop_assert!(last.is_none_or(|last| place > last), "{last:?} {place:?}");
                    prop_assert!(at < message.stamp + message.life);
                    if last.is_none_or(|(started, _)| started != message.session.started) {
                        prop_assert!(message.order != Order::Follow && ends.is_none_or(|ends| at >= ends));
                    }
                    last = Some(place);
                }
                Err(_) => prop_assert_eq!(receiver.act(at), before),
            }
            let follows = matches!(receiver.act(at), Act::Follow(_));
            let is_reported = receiver.last().is_some_and(|m| m.order == Order::Follow);
            prop_assert_eq!(follows, is_reported && receiver.is_alive(at));
            // Whatever came, nothing is obeyed for longer than its life.
            let over = receiver.ends().unwrap_or(0).max(at);
            prop_assert_eq!(receiver.act(over + 60_000_000), Act::Vent);
        }
        let counts = receiver.counts();
        prop_assert_eq!(counts.accepted + counts.all_refused(), arriving.len() as u64);
    }
}
