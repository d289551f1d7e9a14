//! Datagrams under the conformance body, and what is theirs alone.

#![allow(clippy::unwrap_used)]

mod memory;

use std::net::{SocketAddr, UdpSocket};

use stillpoint_samples::{Datagram, Sample};
use stillpoint_transport::conformance::conforms;
use stillpoint_transport::{Channel, Datagrams, Transport, TransportError};

use memory::Fault;

fn free_udp() -> SocketAddr {
    UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap()
}

#[test]
fn datagrams_conform() {
    conforms(&|| Box::new(Datagrams::to(free_udp())));
}

#[test]
fn the_conformance_body_notices_each_fault() {
    assert!(memory::conforms_with(Fault::None));
    for fault in [Fault::Reorders, Fault::Repeats, Fault::Cuts, Fault::TakesAnyType, Fault::SendsWhenClosed] {
        assert!(!memory::conforms_with(fault), "{fault:?} went unnoticed");
    }
}

#[test]
fn an_address_in_use_is_named_with_what_to_do() {
    let channel = Channel { kind: Datagram::KIND, frame: None, capacity: 100 };
    let taken = UdpSocket::bind("127.0.0.1:0").unwrap();
    let error = Datagrams::to(taken.local_addr().unwrap()).open_receiver(&channel).err().unwrap();
    assert!(matches!(error, TransportError::Listen { .. }), "{error}");
    assert!(error.to_string().contains("give the link another port"), "{error}");
}
