//! Test samples, and their way from one end to the other.

use std::time::{Duration, Instant};

use stillpoint_samples::{AlignedBytes, Datagram, HEADER_SIZE, Header, Pieces, Sample, SampleKind};

use crate::{Carries, Channel, Receiver, Sender, Transport};

/// How long a claim may take to come true: longer than any pause of a machine that is busy.
pub const PATIENCE: Duration = Duration::from_secs(60);
/// Bytes of a test sample, where the claim is not about its size.
pub const SMALL: usize = 64;
/// The most bytes of a test sample.
pub const LARGE: usize = 300_000;

/// Bytes, of at most so many.
pub fn channel(capacity: usize) -> Channel {
    Channel { kind: Datagram::KIND, frame: None, capacity }
}

/// A sample of so many bytes, whose content follows from its number.
pub fn sample(number: u64, bytes: usize) -> AlignedBytes {
    let header =
        Header { stamp: number, origin: number, sequence: number, incarnation: 0, count: bytes as u32 };
    let content = (0..bytes as u64).map(|i| (number.wrapping_mul(31).wrapping_add(i) % 251) as u8);
    let mut content: Vec<u8> = content.collect();
    content[..8].copy_from_slice(&number.to_le_bytes());
    AlignedBytes::joined(zerocopy::IntoBytes::as_bytes(&header), &content)
}

pub fn pieces<'a>(kind: &SampleKind, bytes: &'a [u8]) -> Pieces<'a> {
    let (meta, payload) = bytes.split_at(kind.meta_size());
    Pieces { meta, payload }
}

pub fn send(sender: &mut dyn Sender, number: u64, bytes: usize) {
    let sample = sample(number, bytes);
    sender.send(pieces(Datagram::KIND, &sample)).expect("a sample of the channel can be sent");
}

/// Number and content of what arrived.
pub fn opened(carries: Carries, bytes: &[u8]) -> (u64, Vec<u8>) {
    let payload = match carries {
        Carries::Payload { .. } => bytes,
        Carries::Samples => {
            let whole = Pieces::split(Datagram::KIND, bytes).expect("what arrives is a whole sample");
            let number = whole.payload[..8].try_into().map(u64::from_le_bytes).unwrap_or(u64::MAX);
            assert_eq!(whole.header().sequence, number, "the header is the sample's own");
            &bytes[HEADER_SIZE..]
        }
    };
    let number = payload[..8].try_into().map(u64::from_le_bytes).unwrap_or(u64::MAX);
    (number, payload.to_vec())
}

/// All that waits.
pub fn drain(receiver: &mut dyn Receiver, carries: Carries) -> Vec<(u64, Vec<u8>)> {
    let (mut bytes, mut arrived) = (Vec::new(), Vec::new());
    while receiver.receive(&mut bytes).expect("an open end can be asked").is_some() {
        arrived.push(opened(carries, &bytes));
    }
    arrived
}

pub fn wait_for<T>(claim: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let begun = Instant::now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(begun.elapsed() < PATIENCE, "not within {} s: {claim}", PATIENCE.as_secs());
        std::thread::yield_now();
    }
}

/// Both ends, and the number of the next sample: one has passed.
pub fn connected(transport: &dyn Transport, capacity: usize) -> (Box<dyn Sender>, Box<dyn Receiver>, u64) {
    let channel = channel(capacity);
    let mut receiver = transport.open_receiver(&channel).expect("the receiver's end opens");
    let mut sender = transport.open_sender(&channel).expect("the sender's end opens");
    let next = pass(&mut *sender, &mut *receiver, transport.carries(), 0);
    (sender, receiver, next)
}

/// Sends until a sample passes, from this number on. Gives the number of the next sample. Nothing waits any more.
pub fn pass(sender: &mut dyn Sender, receiver: &mut dyn Receiver, carries: Carries, from: u64) -> u64 {
    let mut next = from;
    wait_for("a sample passes", || {
        send(sender, next, SMALL);
        next += 1;
        std::thread::sleep(Duration::from_millis(1));
        drain(receiver, carries).last().map(|_| ())
    });
    let newest = next - 1;
    // A sample that took the place of another one is the newest; what was sent last arrives, unless it is lost.
    settle(sender, receiver, carries, newest)
}

/// Sends until nothing older than the newest sample is under way.
pub fn settle(sender: &mut dyn Sender, receiver: &mut dyn Receiver, carries: Carries, newest: u64) -> u64 {
    let mut next = newest + 1;
    wait_for("the newest sample arrives", || {
        send(sender, next, SMALL);
        let sent = next;
        next += 1;
        let begun = Instant::now();
        while begun.elapsed() < Duration::from_millis(100) {
            if drain(receiver, carries).iter().any(|(number, _)| *number == sent) {
                return Some(());
            }
            std::thread::yield_now();
        }
        None
    });
    next
}

/// Sends one sample and waits until it arrives; a transport may lose it, and then the next one is tried.
pub fn exchange(
    sender: &mut dyn Sender,
    receiver: &mut dyn Receiver,
    carries: Carries,
    next: &mut u64,
    bytes: usize,
) -> Vec<(u64, Vec<u8>)> {
    let mut arrived = Vec::new();
    wait_for("a sample arrives", || {
        send(sender, *next, bytes);
        let sent = *next;
        *next += 1;
        let begun = Instant::now();
        while begun.elapsed() < Duration::from_secs(1) {
            arrived.extend(drain(receiver, carries));
            if arrived.last().is_some_and(|(number, _)| *number == sent) {
                return Some(());
            }
            std::thread::yield_now();
        }
        None
    });
    arrived
}

/// The most bytes of a sample that this transport delivers, for the tests.
pub fn largest(carries: Carries) -> usize {
    match carries {
        Carries::Samples => LARGE,
        Carries::Payload { longest } => longest.min(LARGE),
    }
}
