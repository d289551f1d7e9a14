//! The two ends of links in a live run: sockets beside the ports of an operator.

use std::io::ErrorKind;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};

use crate::graph::OperatorNode;
use crate::link::LONGEST;
use crate::outside::Arrivals;

/// Where datagrams come in for the far end of a link.
pub struct Ear {
    socket: UdpSocket,
    arrivals: Arrivals,
}

impl Ear {
    /// Listens, if this operator is the far end of a link.
    pub fn open(node: &OperatorNode) -> Result<Option<Self>, String> {
        let Some(address) = node.listens else { return Ok(None) };
        let socket = UdpSocket::bind(address).and_then(|s| s.set_nonblocking(true).map(|()| s));
        let socket = socket.map_err(|e| {
            format!(
                "{}: no datagrams can be taken at {address}: {e}; end who listens there, or give the link another port",
                node.name
            )
        })?;
        Ok(Some(Self { socket, arrivals: Arrivals::default() }))
    }

    /// What arrived, for the operator.
    pub fn arrivals(&self) -> Arrivals {
        self.arrivals.clone()
    }

    /// Takes what has arrived.
    pub fn listen(&self) -> Result<(), String> {
        // One byte more than the longest: what is cut here is seen to be too long.
        let mut bytes = [0; LONGEST + 1];
        loop {
            match self.socket.recv_from(&mut bytes) {
                Ok((length, _)) => self.arrivals.put(&bytes[..length]),
                Err(e) if e.kind() == ErrorKind::WouldBlock => return Ok(()),
                // An answer to something that somebody sent from this port: nothing was lost here.
                Err(e) if matches!(e.kind(), ErrorKind::Interrupted | ErrorKind::ConnectionReset) => {}
                Err(e) => return Err(format!("datagrams cannot be taken: {e}")),
            }
        }
    }
}

/// Where samples of an output leave as datagrams.
pub struct Mouth {
    socket: UdpSocket,
    addresses: Vec<SocketAddr>,
    /// The last datagram could not be sent: this is said once.
    is_refused: bool,
}

impl Mouth {
    /// A socket to send from, if the output has links.
    pub fn open(addresses: &[SocketAddr]) -> Result<Option<Self>, String> {
        let Some(first) = addresses.first() else { return Ok(None) };
        let any = match first {
            SocketAddr::V4(_) => IpAddr::V4(Ipv4Addr::UNSPECIFIED),
            SocketAddr::V6(_) => IpAddr::V6(Ipv6Addr::UNSPECIFIED),
        };
        let socket = UdpSocket::bind((any, 0)).and_then(|s| s.set_nonblocking(true).map(|()| s));
        let socket = socket.map_err(|e| format!("no datagrams can be sent to {first}: {e}"))?;
        Ok(Some(Self { socket, addresses: addresses.to_vec(), is_refused: false }))
    }

    /// Sends a datagram to every far end. `Some`: the first of a row could not be sent, and why.
    pub fn send(&mut self, bytes: &[u8]) -> Option<String> {
        let mut refused = None;
        for address in &self.addresses {
            if let Err(e) = self.socket.send_to(bytes, address) {
                refused = Some(format!("a datagram to {address} could not be sent: {e}"));
            }
        }
        let is_new = refused.is_some() && !self.is_refused;
        self.is_refused = refused.is_some();
        refused.filter(|_| is_new)
    }
}
