//! The ports of one operator in shared memory, live and in lock-step.

use stillpoint_samples::SampleKind;
use stillpoint_shm::{Domain, Publisher, ShmError, Subscriber, Topic};

use super::contracts;
use crate::graph::{Edge, Graph};
use crate::schedule::depth_of;

/// How many samples wait on an input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Depth {
    /// As many as the input's policy says: a newer sample takes the place of the oldest.
    OfPolicy,
    /// As many as the topic's buffer holds: whoever directs the operator takes them before there are more.
    OfTopic,
}

/// The ports of one operator.
pub struct Ports {
    /// By input; `None` where it is not connected.
    pub inlets: Vec<Option<Inlet>>,
    /// By output.
    pub outlets: Vec<Outlet>,
    /// Where its journal is published.
    pub journal: Publisher,
    /// Keeps the journal's service alive while this process has a port on it.
    _journal_topic: Topic,
}

/// An input that is connected.
pub struct Inlet {
    /// Takes its samples.
    pub subscriber: Subscriber,
    /// Its topic.
    pub topic: Topic,
    /// Type of its samples.
    pub kind: &'static SampleKind,
    /// Where its samples come from.
    pub edge: Edge,
}

/// An output.
pub struct Outlet {
    /// Sends its samples.
    pub publisher: Publisher,
    /// Its topic.
    pub topic: Topic,
}

impl Ports {
    /// Opens the topics of an operator, and makes its ports on them.
    pub fn open(graph: &Graph, operator: usize, domain: &Domain, depth: Depth) -> Result<Self, ShmError> {
        let node = &graph.operators[operator];
        let mut inlets = Vec::with_capacity(node.inputs.len());
        for (input, port) in node.inputs.iter().zip(node.stage.kind.inputs) {
            let Some(edge) = input.edge else {
                inlets.push(None);
                continue;
            };
            let contract = contracts::output(graph, edge.operator, edge.output);
            let topic = Topic::open(domain, &contract)?;
            let depth = match depth {
                Depth::OfPolicy => depth_of(input.policy),
                Depth::OfTopic => contract.buffer,
            };
            inlets.push(Some(Inlet { subscriber: topic.subscriber(depth)?, topic, kind: port.sample, edge }));
        }
        let mut outlets = Vec::with_capacity(node.outputs.len());
        for port in 0..node.outputs.len() {
            let topic = Topic::open(domain, &contracts::output(graph, operator, port))?;
            outlets.push(Outlet { publisher: topic.publisher()?, topic });
        }
        let journal_topic = Topic::open(domain, &contracts::journal(graph, operator))?;
        let journal = journal_topic.publisher()?;
        Ok(Self { inlets, outlets, journal, _journal_topic: journal_topic })
    }

    /// Connects to all ports that are there.
    pub fn connect(&self) -> Result<(), ShmError> {
        for outlet in &self.outlets {
            outlet.publisher.connect()?;
        }
        self.journal.connect()?;
        for inlet in self.inlets.iter().flatten() {
            inlet.subscriber.connect()?;
        }
        Ok(())
    }
}
