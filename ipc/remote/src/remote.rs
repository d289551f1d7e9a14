//! One edge between hosts as a transport.

use std::sync::Arc;

use stillpoint_transport::{Carries, Channel, Receiver, Sender, Transport, TransportError};

use crate::Host;

/// One edge between hosts, of any type of sample.
#[derive(Clone)]
pub struct Remote {
    host: Arc<Host>,
    edge: String,
}

impl Remote {
    /// The edge of this name, seen from a host.
    pub fn new(host: &Arc<Host>, edge: &str) -> Self {
        Self { host: host.clone(), edge: edge.to_owned() }
    }
}

impl Transport for Remote {
    fn carries(&self) -> Carries {
        Carries::Samples
    }

    fn open_sender(&self, channel: &Channel) -> Result<Box<dyn Sender>, TransportError> {
        let sender = self.host.open_sender(&self.edge, channel);
        Ok(Box::new(sender.map_err(|e| TransportError::Other(e.to_string()))?))
    }

    fn open_receiver(&self, channel: &Channel) -> Result<Box<dyn Receiver>, TransportError> {
        let receiver = self.host.open_receiver(&self.edge, channel);
        Ok(Box::new(receiver.map_err(|e| TransportError::Other(e.to_string()))?))
    }
}
