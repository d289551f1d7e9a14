//! One UDP datagram per sample: the payload alone, so that a device can read it.

use std::io::ErrorKind;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};

use stillpoint_samples::{Pieces, SampleKind};

use crate::{Carries, Channel, LinkState, Origin, Receiver, Sender, Transport, TransportError};

/// The longest datagram that a far end of this project takes, bytes.
pub const LONGEST: usize = 1024;

/// Datagrams to an address, at which the receiver listens.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Datagrams {
    address: SocketAddr,
}

impl Datagrams {
    /// The longest datagram that a far end of this project takes, bytes.
    pub const LONGEST: usize = LONGEST;

    /// Datagrams to this address.
    pub fn to(address: SocketAddr) -> Self {
        Self { address }
    }
}

impl Transport for Datagrams {
    fn carries(&self) -> Carries {
        Carries::Payload { longest: LONGEST }
    }

    fn open_sender(&self, channel: &Channel) -> Result<Box<dyn Sender>, TransportError> {
        let any = match self.address {
            SocketAddr::V4(_) => IpAddr::V4(Ipv4Addr::UNSPECIFIED),
            SocketAddr::V6(_) => IpAddr::V6(Ipv6Addr::UNSPECIFIED),
        };
        let socket = bind((any, 0).into())
            .map_err(|e| TransportError::Open { address: self.address, reason: e.to_string() })?;
        Ok(Box::new(DatagramSender { socket: Some(socket), address: self.address, kind: channel.kind }))
    }

    fn open_receiver(&self, _: &Channel) -> Result<Box<dyn Receiver>, TransportError> {
        let socket = bind(self.address)
            .map_err(|e| TransportError::Listen { address: self.address, reason: e.to_string() })?;
        Ok(Box::new(DatagramReceiver { socket: Some(socket) }))
    }
}

fn bind(address: SocketAddr) -> std::io::Result<UdpSocket> {
    let socket = UdpSocket::bind(address)?;
    socket.set_nonblocking(true)?;
    Ok(socket)
}

fn state(socket: &Option<UdpSocket>) -> LinkState {
    if socket.is_some() { LinkState::Open } else { LinkState::Closed }
}

struct DatagramSender {
    socket: Option<UdpSocket>,
    address: SocketAddr,
    kind: &'static SampleKind,
}

impl Sender for DatagramSender {
    fn send(&mut self, sample: Pieces<'_>) -> Result<(), TransportError> {
        let socket = self.socket.as_ref().ok_or(TransportError::Closed)?;
        let payload = sample.check(self.kind).map_err(TransportError::Sample)?.payload;
        match socket.send_to(payload, self.address) {
            Ok(_) => Ok(()),
            Err(e) => Err(TransportError::Send { address: self.address, reason: e.to_string() }),
        }
    }

    fn state(&self) -> LinkState {
        state(&self.socket)
    }

    fn close(&mut self) {
        self.socket = None;
    }
}

struct DatagramReceiver {
    socket: Option<UdpSocket>,
}

impl Receiver for DatagramReceiver {
    fn receive(&mut self, bytes: &mut Vec<u8>) -> Result<Option<Origin>, TransportError> {
        let socket = self.socket.as_ref().ok_or(TransportError::Closed)?;
        // One byte more than the longest: what is cut here is seen to be too long.
        bytes.resize(LONGEST + 1, 0);
        loop {
            match socket.recv_from(bytes) {
                Ok((length, sender)) => {
                    bytes.truncate(length);
                    return Ok(Some(Origin { sender: Some(sender) }));
                }
                Err(e) if e.kind() == ErrorKind::WouldBlock => return Ok(None),
                // An answer to a datagram that was sent from this port: nothing was lost here.
                Err(e) if matches!(e.kind(), ErrorKind::Interrupted | ErrorKind::ConnectionReset) => {}
                Err(e) => return Err(TransportError::Receive { reason: e.to_string() }),
            }
        }
    }

    fn discarded(&mut self) -> u64 {
        0
    }

    fn keeps_waiting(&self) -> bool {
        false
    }

    fn state(&self) -> LinkState {
        state(&self.socket)
    }

    fn close(&mut self) {
        self.socket = None;
    }
}
