//! Both transports of this crate under the conformance body, and what is TCP's or UDP's alone.

#![allow(clippy::unwrap_used)]

mod memory;

use std::io::Read;
use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::time::Duration;

use stillpoint_samples::{Datagram, DepthImage, HEADER_SIZE, Pieces, Sample};
use stillpoint_transport::conformance::conforms;
use stillpoint_transport::{Channel, Datagrams, Receiver, Sender, Streams, Transport, TransportError};

use memory::Fault;

fn free_tcp() -> SocketAddr {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap()
}

fn free_udp() -> SocketAddr {
    UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap()
}

#[test]
fn datagrams_conform() {
    conforms(&|| Box::new(Datagrams::to(free_udp())));
}

#[test]
fn streams_conform() {
    conforms(&|| Box::new(Streams::at(free_tcp())));
}

#[test]
fn the_conformance_body_notices_each_fault() {
    assert!(memory::conforms_with(Fault::None));
    for fault in [Fault::Reorders, Fault::Repeats, Fault::Cuts, Fault::TakesAnyType, Fault::SendsWhenClosed] {
        assert!(!memory::conforms_with(fault), "{fault:?} went unnoticed");
    }
}

/// A depth image of so many pixels, all of this value.
fn image(pixels: u32, value: u16) -> Vec<u8> {
    let mut bytes = vec![0; DepthImage::KIND.meta_size()];
    let end = bytes.len();
    bytes[HEADER_SIZE - 4..HEADER_SIZE].copy_from_slice(&pixels.to_le_bytes());
    bytes[end - 4..].copy_from_slice(&pixels.to_le_bytes());
    (0..pixels).for_each(|_| bytes.extend_from_slice(&value.to_le_bytes()));
    bytes
}

/// What reaches a receiver when this is offered until something does.
fn first(sender: &mut dyn Sender, bytes: &[u8], receiver: &mut dyn Receiver) -> Vec<u8> {
    let mut arrived = Vec::new();
    while receiver.receive(&mut arrived).unwrap().is_none() {
        sender.send(Pieces::split(DepthImage::KIND, bytes).unwrap()).unwrap();
        std::thread::yield_now();
    }
    arrived
}

#[test]
fn a_client_that_takes_nothing_is_cut_off_and_keeps_nobody_waiting() {
    let address = free_tcp();
    let streams = Streams::at(address);
    let channel = Channel { kind: DepthImage::KIND, frame: None, capacity: 640 * 480 };
    let mut sender = streams.open_sender(&channel).unwrap();
    let mut stopped = TcpStream::connect(address).unwrap();
    let mut receiver = streams.open_receiver(&channel).unwrap();
    let sent = image(640 * 480, 3);
    // More than the socket of the client that is stopped can hold.
    for _ in 0..40 {
        assert_eq!(first(&mut *sender, &sent, &mut *receiver), sent);
    }
    stopped.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    let mut held = Vec::new();
    // It ends, or it is reset: either way nothing more comes.
    let _ = stopped.read_to_end(&mut held);
    assert_eq!(first(&mut *sender, &sent, &mut *receiver), sent);
}

#[test]
fn several_receivers_take_the_same_samples() {
    let streams = Streams::at(free_tcp());
    let channel = Channel { kind: DepthImage::KIND, frame: None, capacity: 100 };
    let mut sender = streams.open_sender(&channel).unwrap();
    let mut receivers = [streams.open_receiver(&channel).unwrap(), streams.open_receiver(&channel).unwrap()];
    let sent = image(100, 7);
    for receiver in &mut receivers {
        assert_eq!(first(&mut *sender, &sent, &mut **receiver), sent);
    }
}

#[test]
fn an_address_in_use_is_named_with_what_to_do() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let channel = Channel { kind: Datagram::KIND, frame: None, capacity: 100 };
    let error = Streams::at(taken.local_addr().unwrap()).open_sender(&channel).err().unwrap();
    assert!(matches!(error, TransportError::Serve { .. }), "{error}");
    assert!(error.to_string().contains("give the link another port"), "{error}");
    let taken = UdpSocket::bind("127.0.0.1:0").unwrap();
    let error = Datagrams::to(taken.local_addr().unwrap()).open_receiver(&channel).err().unwrap();
    assert!(matches!(error, TransportError::Listen { .. }), "{error}");
    assert!(error.to_string().contains("give the link another port"), "{error}");
}
