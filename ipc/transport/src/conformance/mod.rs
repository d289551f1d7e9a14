//! The test body of every transport: order, loss accounted by sequence, samples that are too long, another type or
//! frame, a receiver that stops, and a restart of either end.
//!
//! A crate with a transport of its own calls [`conforms`] in a test.

// The functions are test bodies: a claim that does not hold is a panic.
#![allow(clippy::panic, clippy::expect_used)]

mod exchange;

use stillpoint_samples::{AlignedBytes, Datagram, DepthImage, HEADER_SIZE, Pieces, Sample};

use exchange::{SMALL, channel, connected, exchange, largest, opened, pass, pieces, sample, send, wait_for};

use crate::{Carries, Channel, LinkState, Transport};

/// Runs every claim, each over a transport of its own: `fresh` makes one for an address that nobody uses.
///
/// # Panics
/// Where a claim does not hold.
pub fn conforms(fresh: &dyn Fn() -> Box<dyn Transport>) {
    samples_arrive_unchanged_and_in_order(&*fresh());
    loss_shows_in_the_sequence_numbers(&*fresh());
    a_sample_that_is_too_long_never_arrives_as_a_shorter_one(&*fresh());
    another_type_or_frame_is_refused(&*fresh());
    a_receiver_that_stops_keeps_no_sender_waiting(&*fresh());
    either_end_may_be_opened_anew(&*fresh());
    a_closed_end_does_nothing(&*fresh());
    a_sample_of_another_type_is_not_sent(&*fresh());
}

/// What arrives is what was sent, of any size that the channel has room for, in the order of sending.
///
/// # Panics
/// Where the claim does not hold.
pub fn samples_arrive_unchanged_and_in_order(transport: &dyn Transport) {
    let carries = transport.carries();
    let largest = largest(carries);
    let (mut sender, mut receiver, mut next) = connected(transport, largest);
    let mut last = next - 1;
    for round in 0..50 {
        let bytes = [8, SMALL, 333, largest][round % 4].min(largest);
        for (number, content) in exchange(&mut *sender, &mut *receiver, carries, &mut next, bytes) {
            assert!(number > last, "sample {number} came after sample {last}");
            last = number;
            assert_eq!(
                content,
                sample(number, content.len())[HEADER_SIZE..],
                "the content of sample {number}"
            );
        }
    }
    assert_eq!(sender.state(), LinkState::Open);
    assert_eq!(receiver.state(), LinkState::Open);
}

/// Of a burst, which may lose samples, each sample arrives at most once, and the numbers that are passed over are those
/// that are lost; the newest sample gets through.
///
/// # Panics
/// Where the claim does not hold.
pub fn loss_shows_in_the_sequence_numbers(transport: &dyn Transport) {
    const BURST: u64 = 2_000;
    let carries = transport.carries();
    let (mut sender, mut receiver, first) = connected(transport, SMALL);
    for number in first..first + BURST {
        send(&mut *sender, number, SMALL);
    }
    let mut next = first + BURST;
    let mut arrived: Vec<u64> = Vec::new();
    let after = exchange(&mut *sender, &mut *receiver, carries, &mut next, SMALL);
    arrived.extend(after.iter().map(|(number, _)| *number));
    let discarded = receiver.discarded();
    assert!(arrived.is_sorted_by(|a, b| a < b), "in order, and none twice: {arrived:?}");
    let passed_over: u64 =
        arrived.windows(2).map(|pair| pair[1] - pair[0] - 1).sum::<u64>() + arrived[0] - first;
    assert_eq!(passed_over + arrived.len() as u64, next - first, "every number is there or passed over");
    assert!(discarded <= passed_over, "{discarded} discarded of {passed_over} that are missing");
}

/// A sample beyond the channel's room is refused, or is seen to be too long: it never arrives as a shorter one.
///
/// # Panics
/// Where the claim does not hold.
pub fn a_sample_that_is_too_long_never_arrives_as_a_shorter_one(transport: &dyn Transport) {
    let carries = transport.carries();
    let room = match carries {
        Carries::Samples => 1_000,
        Carries::Payload { longest } => longest,
    };
    // The sender's end knows of more room than the receiver's.
    let mut receiver = transport.open_receiver(&channel(room)).expect("the receiver's end opens");
    let mut sender = transport.open_sender(&channel(10 * room)).expect("the sender's end opens");
    pass(&mut *sender, &mut *receiver, carries, 0);
    let long = sample(1_000_000, room + 100);
    let mut bytes = Vec::new();
    wait_for("a sample that is too long is refused", || {
        // A sender may refuse it itself.
        if sender.send(pieces(Datagram::KIND, &long)).is_err() {
            return Some(());
        }
        while receiver.receive(&mut bytes).expect("an open end can be asked").is_some() {
            match carries {
                Carries::Payload { longest } if bytes.len() > longest => return Some(()),
                _ => {
                    let (number, _) = opened(carries, &bytes);
                    assert_ne!(
                        number,
                        1_000_000,
                        "a sample that is too long arrived with {} bytes",
                        bytes.len()
                    );
                }
            }
        }
        matches!(receiver.state(), LinkState::Refused(_)).then_some(())
    });
}

/// A receiver of another type or another frame takes nothing, and says so. A transport of payloads alone cannot know.
///
/// # Panics
/// Where the claim does not hold.
pub fn another_type_or_frame_is_refused(transport: &dyn Transport) {
    if transport.carries() != Carries::Samples {
        return;
    }
    let served = Channel { kind: DepthImage::KIND, frame: Some("camera".to_string()), capacity: 16 };
    let mut sender = transport.open_sender(&served).expect("the sender's end opens");
    let mut image = AlignedBytes::zeroed(DepthImage::KIND.meta_size() + 2 * DepthImage::KIND.element_size);
    let end = DepthImage::KIND.meta_size();
    image[HEADER_SIZE - 4..HEADER_SIZE].copy_from_slice(&2_u32.to_le_bytes());
    image[end - 4..end].copy_from_slice(&2_u32.to_le_bytes());
    let other_type = Channel { kind: Datagram::KIND, ..served.clone() };
    let other_frame = Channel { frame: Some("couch".to_string()), ..served.clone() };
    for other in [other_type, other_frame] {
        let mut receiver = transport.open_receiver(&other).expect("the receiver's end opens");
        let refusal = wait_for("another type or frame is refused", || {
            sender.send(pieces(DepthImage::KIND, &image)).expect("an image can be sent");
            let mut bytes = Vec::new();
            assert_eq!(receiver.receive(&mut bytes), Ok(None), "nothing may pass");
            match receiver.state() {
                LinkState::Refused(refusal) => Some(refusal.to_string()),
                _ => None,
            }
        });
        let (found, expected) = (served.name(), other.name());
        assert!(refusal.contains(&found) && refusal.contains(&expected), "{refusal}");
    }
    // The right receiver is not disturbed by them.
    let mut receiver = transport.open_receiver(&served).expect("the receiver's end opens");
    let bytes = wait_for("the right receiver takes the image", || {
        sender.send(pieces(DepthImage::KIND, &image)).expect("an image can be sent");
        let mut bytes = Vec::new();
        receiver.receive(&mut bytes).expect("an open end can be asked").map(|_| bytes)
    });
    assert_eq!(bytes[..], image[..]);
}

/// A receiver that takes nothing keeps neither the sender waiting nor its own memory growing; when it goes on, what is
/// missing shows in the numbers, and new samples pass.
///
/// # Panics
/// Where the claim does not hold.
pub fn a_receiver_that_stops_keeps_no_sender_waiting(transport: &dyn Transport) {
    const SENT: u64 = 100;
    let carries = transport.carries();
    let bytes = largest(carries);
    let (mut sender, mut receiver, first) = connected(transport, bytes);
    for number in first..first + SENT {
        send(&mut *sender, number, bytes);
    }
    let mut next = first + SENT;
    let arrived = exchange(&mut *sender, &mut *receiver, carries, &mut next, bytes);
    assert!(arrived.is_sorted_by(|(a, _), (b, _)| a < b), "in order, and none twice");
    assert!(arrived.len() as u64 <= next - first);
    for (number, content) in arrived {
        assert_eq!(content, sample(number, bytes)[HEADER_SIZE..], "the content of sample {number}");
    }
}

/// Either end may be closed and opened anew while the other one stays.
///
/// # Panics
/// Where the claim does not hold.
pub fn either_end_may_be_opened_anew(transport: &dyn Transport) {
    let carries = transport.carries();
    let (mut sender, mut receiver, mut next) = connected(transport, SMALL);
    for _ in 0..2 {
        sender.close();
        drop(sender);
        sender = wait_for("the sender's end opens anew", || transport.open_sender(&channel(SMALL)).ok());
        next = pass(&mut *sender, &mut *receiver, carries, next);
        receiver.close();
        drop(receiver);
        receiver =
            wait_for("the receiver's end opens anew", || transport.open_receiver(&channel(SMALL)).ok());
        next = pass(&mut *sender, &mut *receiver, carries, next);
    }
}

/// A closed end says that it is closed.
///
/// # Panics
/// Where the claim does not hold.
pub fn a_closed_end_does_nothing(transport: &dyn Transport) {
    let (mut sender, mut receiver, next) = connected(transport, SMALL);
    sender.close();
    assert_eq!(sender.state(), LinkState::Closed);
    let one = sample(next, SMALL);
    assert!(sender.send(pieces(Datagram::KIND, &one)).is_err(), "a closed end sends nothing");
    receiver.close();
    assert_eq!(receiver.state(), LinkState::Closed);
    assert!(receiver.receive(&mut Vec::new()).is_err(), "a closed end takes nothing");
}

/// Bytes that are no sample of the channel are refused by the sender.
///
/// # Panics
/// Where the claim does not hold.
pub fn a_sample_of_another_type_is_not_sent(transport: &dyn Transport) {
    let (mut sender, _receiver, next) = connected(transport, SMALL);
    assert!(
        sender.send(Pieces { meta: &[], payload: &[] }).is_err(),
        "bytes without a header are not sample"
    );
    let one = sample(next, SMALL);
    let cut = Pieces { meta: &one[..HEADER_SIZE], payload: &one[HEADER_SIZE..HEADER_SIZE + 10] };
    assert!(sender.send(cut).is_err(), "a sample whose elements are cut is none");
}
