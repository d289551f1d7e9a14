//! The two ends of links in a live run: a transport beside the ports of an operator.

use std::time::Instant;

use stillpoint_samples::Pieces;
use stillpoint_shm::{Domain, ShmError};
use stillpoint_transport::{
    Channel, Datagrams, LinkRefusal, LinkState, Sender, StreamReceiver, Transport, TransportError,
};

use super::contracts;
use super::error::WorkerError;
use super::landing::{Inflow, Landing};
use super::rate_limit::RateLimit;
use crate::graph::{Graph, OperatorNode, Wire};
use crate::operator::{Listening, WireForm};
use crate::outside::{Arrivals, MOST_DATAGRAMS};
use crate::{far_end, pool_client};

/// An end of a link that cannot be opened or used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{place}: {reason}")]
pub struct LinkError {
    /// The topic that is sent, or the operator at the far end.
    pub place: String,
    /// The transport's reason.
    pub reason: TransportError,
}

/// The transport of a link.
pub type TransportOf = fn(Wire) -> Option<Box<dyn Transport>>;

/// The transports of links; `None` for what the bridge carries. A program that brings another
/// transport gives its own function to
/// [`worker_main_over`](super::worker_main_over), and leaves all other links to this one.
pub fn transport_of(wire: Wire) -> Option<Box<dyn Transport>> {
    match wire {
        Wire::Udp(address) => Some(Box::new(Datagrams::to(address))),
        Wire::Host(_) | Wire::Ros2 | Wire::Pool(_) => None,
    }
}

/// The channel of an output's links.
fn channel(node: &OperatorNode, port: usize) -> Channel {
    let output = &node.outputs[port];
    let kind = node.stage.kind.outputs[port].sample;
    Channel { kind, frame: output.frame.clone(), capacity: output.capacity }
}

/// Samples before the operator where the receiver keeps others waiting itself.
const ONE: usize = 1;

/// Takes samples in for the far end of a link.
pub struct LinkReceiver {
    place: String,
    receiver: Inflow,
    arrivals: Arrivals,
    /// The form of its datagrams, where they have one.
    form: Option<WireForm>,
    limit: RateLimit,
    buffer: Vec<u8>,
    /// The refusal that was told last.
    refusal: Option<LinkRefusal>,
}

impl LinkReceiver {
    /// Opens the receiver's end, if this operator is the far end of a link or its samples come over the network.
    pub fn open(
        graph: &Graph,
        operator: usize,
        domain: &Domain,
        transport_of: TransportOf,
    ) -> Result<Option<Self>, WorkerError> {
        let node = &graph.operators[operator];
        if let Some(listening) = &node.listens {
            return Self::of_program(node, listening).map(Some);
        }
        let Some(wire) = node.far_end else { return Ok(None) };
        let receiver = match transport_of(wire) {
            Some(transport) => {
                let opened = transport.open_receiver(&channel(node, far_end::SAMPLE));
                Inflow::Link(opened.map_err(|reason| LinkError { place: node.name.clone(), reason })?)
            }
            // Both ends are in this run: the samples come over an edge.
            None if node.inputs.iter().any(|i| i.edge.is_some()) => return Ok(None),
            None => Inflow::Bridge(Box::new(Landing::open(domain, &contracts::landing(graph, operator))?)),
        };
        let most = match wire {
            Wire::Pool(_) => pool_client::MOST_WAITING,
            _ if receiver.keeps_waiting() => ONE,
            _ => MOST_DATAGRAMS,
        };
        Ok(Some(Self {
            place: node.name.clone(),
            receiver,
            arrivals: Arrivals::at_most(most),
            form: node.wire_form,
            limit: RateLimit::default(),
            buffer: Vec::new(),
            refusal: None,
        }))
    }

    /// Listens for another program on this host.
    fn of_program(node: &OperatorNode, listening: &Listening) -> Result<Self, WorkerError> {
        let Listening { socket, beginning, longest } = listening;
        let opened = StreamReceiver::listen(socket, *beginning, *longest);
        let receiver = opened.map_err(|reason| LinkError { place: node.name.clone(), reason })?;
        Ok(Self {
            place: node.name.clone(),
            receiver: Inflow::Link(Box::new(receiver)),
            arrivals: Arrivals::at_most(ONE),
            form: None,
            limit: RateLimit::default(),
            buffer: Vec::new(),
            refusal: None,
        })
    }

    /// The messages that arrived, for the operator.
    pub fn arrivals(&self) -> Arrivals {
        self.arrivals.clone()
    }

    /// Connects to a bridge that begins anew, if the samples come from one.
    pub fn connect(&self) -> Result<(), ShmError> {
        self.receiver.connect()
    }

    /// Takes what has arrived. Gives the reason for which nothing passes, once per reason.
    pub fn listen(&mut self) -> Result<Option<LinkRefusal>, LinkError> {
        let failed = |reason| LinkError { place: self.place.clone(), reason };
        // What the receiver keeps waiting stays there while the operator has not taken what came before.
        while !(self.receiver.keeps_waiting() && self.arrivals.is_full()) {
            let received = self.receiver.receive(&mut self.buffer).map_err(failed)?;
            let Some((origin, clock)) = received else { break };
            if let Some(clock) = clock {
                self.arrivals.set_clock(clock);
            }
            if let Some(sender) = origin.sender {
                // What nobody sends who sends over this link is counted, and never becomes a sample.
                if self.form.is_some_and(|form| !form.fits(&self.buffer)) {
                    self.arrivals.count_foreign();
                    continue;
                }
                if !self.limit.passes(sender, Instant::now()) {
                    self.arrivals.count_above(sender.ip());
                    continue;
                }
            }
            self.arrivals.put(origin.sender, &mut self.buffer);
        }
        self.arrivals.count_dropped(self.receiver.discarded());
        let refusal = match self.receiver.state() {
            LinkState::Refused(refusal) => Some(refusal),
            LinkState::Waiting | LinkState::Open | LinkState::Closed => None,
        };
        let is_new = refusal.is_some() && refusal != self.refusal;
        self.refusal.clone_from(&refusal);
        Ok(refusal.filter(|_| is_new))
    }
}

/// Sends the samples of an output over its links.
pub struct LinkSender {
    senders: Vec<Box<dyn Sender>>,
    /// The last sample could not be sent: the first of a row is told.
    is_failing: bool,
}

impl LinkSender {
    /// Opens the sender's end of every link of an output; `None` where it has none.
    pub fn open(
        node: &OperatorNode,
        port: usize,
        transport_of: TransportOf,
    ) -> Result<Option<Self>, LinkError> {
        let output = &node.outputs[port];
        if output.links.is_empty() {
            return Ok(None);
        }
        let channel = channel(node, port);
        let transports = output.links.iter().filter_map(|wire| transport_of(*wire));
        let senders: Result<Vec<_>, _> = transports.map(|t| t.open_sender(&channel)).collect();
        let senders = senders.map_err(|reason| LinkError { place: output.topic.clone(), reason })?;
        Ok(Some(Self { senders, is_failing: false }))
    }

    /// Sends a sample over every link. Gives the last reason where it did not go over one, once per row of such samples.
    pub fn send(&mut self, sample: Pieces<'_>) -> Option<TransportError> {
        let failure = self.senders.iter_mut().filter_map(|sender| sender.send(sample).err()).last();
        let is_first = failure.is_some() && !self.is_failing;
        self.is_failing = failure.is_some();
        failure.filter(|_| is_first)
    }
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;

    use stillpoint_samples::{Duties, Sample};

    use super::*;

    #[test]
    fn the_first_of_a_row_of_samples_that_cannot_be_sent_is_told() {
        let address = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        let channel = Channel { kind: Duties::KIND, frame: None, capacity: 1 };
        let sender = Datagrams::to(address).open_sender(&channel).unwrap();
        let mut link_sender = LinkSender { senders: vec![sender], is_failing: false };
        let short = Pieces { meta: &[], payload: &[] };
        let reported = link_sender.send(short).unwrap().to_string();
        assert!(reported.starts_with("a sample did not go over its link"), "{reported}");
        assert_eq!(link_sender.send(short), None);
    }
}
