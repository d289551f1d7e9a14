//! A topic of a running pipeline that is read without being a part of it.

use stillpoint_pipeline::config::near::nearest;
use stillpoint_pipeline::graph::Graph;
use stillpoint_pipeline::live::contracts;
use stillpoint_samples::{Diagnostics, Journal, Sample, SampleKind};
use stillpoint_shm::{Contract, Received, Subscriber, Topic};

use crate::attach::Attached;
use crate::exit::Failure;

/// A topic of a running pipeline that is read without being a part of it.
pub struct Tap {
    /// Name of the topic.
    pub name: String,
    subscriber: Subscriber,
    _topic: Topic,
}

impl Tap {
    /// Opens the topic of an operator's output.
    ///
    /// # Errors
    /// The run has ended, or takes no further reader.
    pub fn open(attached: &Attached, operator: usize, output: usize) -> Result<Self, Failure> {
        Self::of_contract(attached, contracts::output(&attached.graph, operator, output))
    }

    /// Opens the topic of this name, `operator.port`, `operator.journal` or `operator.timing`. Gives the type of its samples,
    /// too.
    ///
    /// # Errors
    /// There is no such topic, the run has ended, or takes no further reader.
    pub fn of_topic(attached: &Attached, name: &str) -> Result<(Self, &'static SampleKind), Failure> {
        let (contract, kind) = find(&attached.graph, name)?;
        Ok((Self::of_contract(attached, contract)?, kind))
    }

    fn of_contract(attached: &Attached, contract: Contract) -> Result<Self, Failure> {
        let topic = Topic::open(&attached.domain, &contract).map_err(Failure::failed)?;
        let subscriber = topic.subscriber(contracts::TAP_DEPTH).map_err(Failure::failed)?;
        subscriber.connect().map_err(Failure::failed)?;
        Ok(Self { name: contract.topic, subscriber, _topic: topic })
    }

    /// The next sample, if there is one.
    ///
    /// # Errors
    /// The topic cannot be read.
    pub fn next(&self) -> Result<Option<Received>, Failure> {
        self.subscriber.receive().map_err(Failure::failed)
    }
}

/// The contract of a topic of a graph, and the kind of its samples.
fn find(graph: &Graph, topic: &str) -> Result<(Contract, &'static SampleKind), Failure> {
    if let Some((operator, port)) = graph.topic(topic) {
        let kind = graph.operators[operator].stage.kind.outputs[port].sample;
        return Ok((contracts::output(graph, operator, port), kind));
    }
    let numbers = || 0..graph.operators.len();
    if let Some(timing) = numbers().filter_map(|o| contracts::timing(graph, o)).find(|c| c.topic == topic) {
        return Ok((timing, Diagnostics::KIND));
    }
    if let Some(journal) = numbers().map(|o| contracts::journal(graph, o)).find(|c| c.topic == topic) {
        return Ok((journal, Journal::KIND));
    }
    let outputs = graph.operators.iter().flat_map(|o| o.outputs.iter().map(|p| p.topic.clone()));
    let measured = numbers().filter_map(|o| Some(contracts::timing(graph, o)?.topic));
    let all: Vec<String> = outputs.chain(measured).collect();
    Err(no_topic(topic, all.iter().map(String::as_str)))
}

/// There is no topic of this name: the nearest name, and all that there are.
pub fn no_topic<'a>(topic: &str, all: impl Iterator<Item = &'a str>) -> Failure {
    let all: Vec<&str> = all.collect();
    let near =
        nearest(topic, all.iter().copied()).map_or_else(String::new, |n| format!(", did you mean {n}?"));
    Failure::wrong(format!("there is no topic `{topic}`{near}; there are {}", all.join(", ")))
}
