//! The samples of one edge, and the messages of ROS 2, from shared memory to the network or back.

use std::collections::BTreeMap;

use stillpoint_operator::outside::ClockOffset;
use stillpoint_samples::SampleKind;
use stillpoint_shm::{Domain, Listener, Publisher, ShmError, Subscriber, Topic};
use stillpoint_transport::{LinkRefusal, LinkState, Receiver, Sender};

use super::accounts::{ArrivedCounts, LeftCounts};
use super::hello::{ArrivesFrom, Arriving, Leaving};
use super::network::Network;
use super::ros2::{Publishing, SubscriptionDef};
use crate::ledger::ShmAccount;
use crate::live::error::WorkerError;
use crate::live::landing;
use crate::live::wire::LinkError;

/// A topic that leaves.
pub struct Outgoing {
    operator: usize,
    port: usize,
    depth: usize,
    kind: &'static SampleKind,
    subscriber: Subscriber,
    senders: Vec<(String, Box<dyn Sender>)>,
    /// By incarnation of the operator that sends it.
    taken: BTreeMap<u32, ShmAccount>,
    refusal: Option<LinkRefusal>,
    _topic: Topic,
}

impl Outgoing {
    pub fn open(
        leaving: &Leaving,
        domain: &Domain,
        network: &dyn Network,
        listeners: &mut Vec<Listener>,
    ) -> Result<Self, WorkerError> {
        let topic = Topic::open(domain, &leaving.contract)?;
        listeners.push(topic.listener()?);
        let channel = leaving.channel.channel();
        let failed = |place: &str, reason| LinkError { place: place.to_owned(), reason };
        let mut senders: Vec<(String, Box<dyn Sender>)> = Vec::new();
        for edge in &leaving.edges {
            let sender =
                network.transport(edge).and_then(|t| t.open_sender(&channel)).map_err(|e| failed(edge, e))?;
            senders.push((edge.clone(), sender));
        }
        for publication in &leaving.publications {
            let opened = Publishing::open(publication, &channel, network);
            let sender = opened.map_err(|e| failed(&publication.topic, e))?;
            senders.push((publication.name.clone(), Box::new(sender)));
        }
        Ok(Self {
            operator: leaving.operator,
            port: leaving.port,
            depth: leaving.depth,
            kind: channel.kind,
            subscriber: topic.subscriber(leaving.depth)?,
            senders,
            taken: BTreeMap::new(),
            refusal: None,
            _topic: topic,
        })
    }

    pub fn connect(&self) -> Result<(), ShmError> {
        self.subscriber.connect().map(drop)
    }

    /// Gives what waits to the network, at most what the buffer holds. Gives whether there was anything.
    pub fn pass_on(&mut self) -> Result<bool, ShmError> {
        for number in 0..self.depth {
            let Some(sample) = self.subscriber.receive()? else { return Ok(number > 0) };
            let header = sample.header();
            self.taken.entry(header.incarnation).or_default().take(header.sequence);
            let Ok(pieces) = sample.pieces().check(self.kind) else { continue };
            for (_, sender) in &mut self.senders {
                // The sender counts what it is given; it has no other failure than to be closed.
                let _ = sender.send(pieces);
            }
        }
        Ok(true)
    }

    /// The reason for which nothing passes, if there is a new one.
    pub fn refusal(&mut self) -> Option<String> {
        let mut states = self.senders.iter().map(|(_, sender)| sender.state());
        new_refusal(states.find(|s| matches!(s, LinkState::Refused(_))), &mut self.refusal)
    }

    /// Whether all that was given to the network has arrived, as far as there is somebody to take it.
    pub fn is_settled(&self, network: &dyn Network) -> bool {
        let sent = network.sent();
        self.senders.iter().all(|(edge, sender)| {
            let counts = sent.get(edge).copied().unwrap_or_default();
            sender.state() != LinkState::Open
                || (counts.waiting == 0 && counts.received + counts.refused >= counts.put)
        })
    }

    pub fn counts(&self, network: &dyn Network) -> LeftCounts {
        let sent = network.sent();
        let of = |edge: &String| (edge.clone(), sent.get(edge).copied().unwrap_or_default());
        LeftCounts {
            operator: self.operator,
            port: self.port,
            taken: self.taken.iter().map(|(incarnation, account)| (*incarnation, *account)).collect(),
            edges: self.senders.iter().map(|(edge, _)| of(edge)).collect(),
        }
    }
}

/// An edge that arrives, or what arrives from ROS 2.
pub struct Incoming {
    operator: usize,
    edge: String,
    depth: usize,
    /// The clock of what arrives, where it is not that of a host.
    clock: Option<ClockOffset>,
    receiver: Box<dyn Receiver>,
    publisher: Publisher,
    buffer: Vec<u8>,
    /// Samples handed over.
    landed: u64,
    /// Samples for which there was no room.
    pool_exhausted: u64,
    refusal: Option<LinkRefusal>,
    _topic: Topic,
}

impl Incoming {
    pub fn open(arriving: &Arriving, domain: &Domain, network: &dyn Network) -> Result<Self, WorkerError> {
        let topic = Topic::open(domain, &arriving.landing)?;
        let (receiver, clock) = match &arriving.from {
            ArrivesFrom::Host(channel) => {
                let transport = network.transport(&arriving.edge);
                (transport.and_then(|t| t.open_receiver(&channel.channel())), None)
            }
            ArrivesFrom::Ros2(taken) => {
                let taken: Vec<_> = taken.iter().map(SubscriptionDef::subscription).collect();
                // The source reads the clock of a message in the message.
                let here = ClockOffset { offset: 0, uncertainty: 0 };
                (network.subscriber(&arriving.edge, &taken), Some(here))
            }
        };
        Ok(Self {
            operator: arriving.operator,
            edge: arriving.edge.clone(),
            depth: arriving.landing.buffer,
            clock,
            receiver: receiver.map_err(|reason| LinkError { place: arriving.edge.clone(), reason })?,
            publisher: topic.publisher()?,
            buffer: Vec::new(),
            landed: 0,
            pool_exhausted: 0,
            refusal: None,
            _topic: topic,
        })
    }

    pub fn connect(&self) -> Result<(), ShmError> {
        self.publisher.connect()
    }

    /// Hands over what has arrived, at most what the buffer holds. Gives whether there was anything.
    pub fn hand_over(&mut self, network: &dyn Network) -> Result<bool, WorkerError> {
        // Without its clock, the time of acquisition of a sample is not known here.
        let Some(clock) = self.clock.or_else(|| network.clock(&self.edge)) else { return Ok(false) };
        let failed = |edge: &str, reason| LinkError { place: edge.to_owned(), reason };
        for number in 0..self.depth {
            let taken = self.receiver.receive(&mut self.buffer).map_err(|e| failed(&self.edge, e))?;
            if taken.is_none() {
                return Ok(number > 0);
            }
            match landing::put(&self.publisher, self.landed, clock, &self.buffer)? {
                true => self.landed += 1,
                false => self.pool_exhausted += 1,
            }
        }
        Ok(true)
    }

    /// The reason for which nothing passes, if there is a new one.
    pub fn refusal(&mut self) -> Option<String> {
        new_refusal(Some(self.receiver.state()), &mut self.refusal)
    }

    pub fn counts(&self, network: &dyn Network) -> ArrivedCounts {
        ArrivedCounts {
            operator: self.operator,
            edge: self.edge.clone(),
            network: network.taken().get(&self.edge).copied().unwrap_or_default(),
            landed: self.landed,
            pool_exhausted: self.pool_exhausted,
        }
    }
}

fn new_refusal(state: Option<LinkState>, reported: &mut Option<LinkRefusal>) -> Option<String> {
    let refusal = match state {
        Some(LinkState::Refused(refusal)) => Some(refusal),
        _ => None,
    };
    let is_new = refusal.is_some() && refusal != *reported;
    reported.clone_from(&refusal);
    refusal.filter(|_| is_new).map(|r| r.to_string())
}
