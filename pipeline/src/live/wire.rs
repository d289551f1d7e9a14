//! The two ends of links in a live run: sockets beside the ports of an operator.

use std::io::ErrorKind;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};

use stillpoint_samples::{Pieces, SampleKind};

use super::serving::{Client, Server, greeting};
use crate::graph::{OperatorNode, Wire};
use crate::link::LONGEST;
use crate::outside::{Arrivals, MOST_DATAGRAMS};
use crate::stream;

/// Where things come in for the far end of a link.
pub enum LinkReceiver {
    /// Datagrams.
    Socket(UdpSocket, Arrivals),
    /// Samples of a stream.
    Stream(Client),
}

impl LinkReceiver {
    /// Listens, if this operator is the far end of a link.
    pub fn open(node: &OperatorNode) -> Result<Option<Self>, String> {
        let address = match node.far_end {
            None => return Ok(None),
            Some(Wire::Udp(address)) => address,
            Some(Wire::Tcp(address)) => {
                let kind = node.stage.kind.outputs[stream::SAMPLE].sample;
                let output = &node.outputs[stream::SAMPLE];
                let longest = kind.meta_size() + output.capacity * kind.element_size;
                let greeting = greeting(kind, output.frame.as_deref());
                return Ok(Some(Self::Stream(Client::start(address, greeting, longest))));
            }
        };
        let socket = UdpSocket::bind(address).and_then(|s| s.set_nonblocking(true).map(|()| s));
        let socket = socket.map_err(|e| {
            format!(
                "{}: no datagrams can be taken at {address}: {e}; end who listens there, or give the link another port",
                node.name
            )
        })?;
        Ok(Some(Self::Socket(socket, Arrivals::at_most(MOST_DATAGRAMS))))
    }

    /// What arrived, for the operator.
    pub fn arrivals(&self) -> Arrivals {
        match self {
            Self::Socket(_, arrivals) => arrivals.clone(),
            Self::Stream(client) => client.arrivals(),
        }
    }

    /// Takes what has arrived. `Some`: why nothing comes, said once.
    pub fn listen(&self) -> Result<Option<String>, String> {
        let (socket, arrivals) = match self {
            Self::Socket(socket, arrivals) => (socket, arrivals),
            Self::Stream(client) => return Ok(client.complaint()),
        };
        // One byte more than the longest: what is cut here is seen to be too long.
        let mut bytes = [0; LONGEST + 1];
        loop {
            match socket.recv_from(&mut bytes) {
                Ok((length, sender)) => arrivals.put_from(sender, &bytes[..length]),
                Err(e) if e.kind() == ErrorKind::WouldBlock => return Ok(None),
                // An answer to something that somebody sent from this port: nothing was lost here.
                Err(e) if matches!(e.kind(), ErrorKind::Interrupted | ErrorKind::ConnectionReset) => {}
                Err(e) => return Err(format!("datagrams cannot be taken: {e}")),
            }
        }
    }
}

/// Where samples of an output leave.
pub struct LinkSender {
    kind: &'static SampleKind,
    datagrams: Option<Datagrams>,
    servers: Vec<Server>,
    /// The last sample could not be sent: this is said once.
    is_refused: bool,
}

impl LinkSender {
    /// What is needed to send over the links of an output, if it has any.
    pub fn open(node: &OperatorNode, port: usize) -> Result<Option<Self>, String> {
        let output = &node.outputs[port];
        let kind = node.stage.kind.outputs[port].sample;
        if output.links.is_empty() {
            return Ok(None);
        }
        let (mut addresses, mut servers) = (Vec::new(), Vec::new());
        for link in &output.links {
            match link {
                Wire::Udp(address) => addresses.push(*address),
                Wire::Tcp(address) => {
                    let greeting = greeting(kind, output.frame.as_deref());
                    servers.push(Server::start(*address, greeting).map_err(|e| {
                        format!(
                            "{} cannot be served at {address}: {e}; end who serves there, or give the link another port",
                            output.topic
                        )
                    })?);
                }
            }
        }
        Ok(Some(Self { kind, datagrams: Datagrams::open(addresses)?, servers, is_refused: false }))
    }

    /// Sends a sample to every far end. `Some`: the first of a row could not be sent, and why.
    pub fn send(&mut self, pieces: Pieces<'_>) -> Option<String> {
        let refused = self.try_send(pieces).err();
        let is_new = refused.is_some() && !self.is_refused;
        self.is_refused = refused.is_some();
        refused.filter(|_| is_new)
    }

    fn try_send(&self, pieces: Pieces<'_>) -> Result<(), String> {
        let sample =
            pieces.check(self.kind).map_err(|e| format!("a sample did not go over its link: {e}"))?;
        for server in &self.servers {
            server.put(sample);
        }
        self.datagrams.as_ref().map_or(Ok(()), |datagrams| datagrams.send(sample.payload))
    }
}

struct Datagrams {
    socket: UdpSocket,
    addresses: Vec<SocketAddr>,
}

impl Datagrams {
    fn open(addresses: Vec<SocketAddr>) -> Result<Option<Self>, String> {
        let Some(first) = addresses.first() else { return Ok(None) };
        let any = match first {
            SocketAddr::V4(_) => IpAddr::V4(Ipv4Addr::UNSPECIFIED),
            SocketAddr::V6(_) => IpAddr::V6(Ipv6Addr::UNSPECIFIED),
        };
        let socket = UdpSocket::bind((any, 0)).and_then(|s| s.set_nonblocking(true).map(|()| s));
        let socket = socket.map_err(|e| format!("no datagrams can be sent to {first}: {e}"))?;
        Ok(Some(Self { socket, addresses }))
    }

    /// Sends to all; the last reason where some could not.
    fn send(&self, bytes: &[u8]) -> Result<(), String> {
        let mut sent = Ok(());
        for address in &self.addresses {
            if let Err(e) = self.socket.send_to(bytes, address) {
                sent = Err(format!("a datagram to {address} could not be sent: {e}"));
            }
        }
        sent
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_samples::{Duties, Sample};

    #[test]
    fn the_first_of_a_row_of_samples_that_cannot_be_sent_is_told() {
        let mut link_sender =
            LinkSender { kind: Duties::KIND, datagrams: None, servers: Vec::new(), is_refused: false };
        let short = Pieces { meta: &[], payload: &[] };
        assert!(link_sender.send(short).unwrap().starts_with("a sample did not go over its link"));
        assert_eq!(link_sender.send(short), None);
    }
}
