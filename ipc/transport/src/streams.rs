//! Whole samples of any size over TCP: the sender serves them, each receiver connects.
//!
//! A receiver reads a line that names type, layout and frame, and then samples, each after its length. The sender never
//! waits: the newest sample replaces one that has not been sent yet. A receiver that does not take a sample within a
//! time is disconnected, and may connect again.

use std::net::SocketAddr;

use crate::client::Client;
use crate::serving::Server;
use crate::{Carries, Channel, Receiver, Sender, Transport, TransportError};

/// Samples served at an address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Streams {
    address: SocketAddr,
}

impl Streams {
    /// The most receivers of one sender.
    pub const MOST_RECEIVERS: usize = crate::serving::MOST_CLIENTS;
    /// Samples that wait at a receiver; one on top costs the oldest.
    pub const MOST_WAITING: usize = crate::client::MOST_WAITING;

    /// Samples served at this address.
    pub fn at(address: SocketAddr) -> Self {
        Self { address }
    }
}

impl Transport for Streams {
    fn carries(&self) -> Carries {
        Carries::Samples
    }

    fn open_sender(&self, channel: &Channel) -> Result<Box<dyn Sender>, TransportError> {
        Ok(Box::new(Server::start(self.address, channel)?))
    }

    fn open_receiver(&self, channel: &Channel) -> Result<Box<dyn Receiver>, TransportError> {
        Ok(Box::new(Client::start(self.address, channel)?))
    }
}
