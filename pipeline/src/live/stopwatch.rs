//! The laps of an operator: how long the stages of its steps took, measured here and sent as a topic.
//!
//! The operator reports the end of a stage, and gets no answer. So its work does not depend on the measurement, and
//! replay, which measures nothing, does the same work.

use std::time::Instant;

use stillpoint_samples::{Entry, HEADER_SIZE, Header, Metric};
use stillpoint_shm::{Domain, Publisher, ShmError, Topic};
use zerocopy::IntoBytes;

use super::contracts;
use crate::graph::Graph;

/// Measures the laps of one activation after the other.
pub struct Stopwatch {
    publisher: Publisher,
    since: Instant,
    laps: Vec<Metric>,
    /// Keeps the service alive while this process has a port on it.
    _topic: Topic,
}

impl Stopwatch {
    /// The stopwatch of an operator, if its kind has laps.
    pub fn open(graph: &Graph, operator: usize, domain: &Domain) -> Result<Option<Self>, ShmError> {
        let Some(contract) = contracts::timing(graph, operator) else { return Ok(None) };
        let topic = Topic::open(domain, &contract)?;
        let laps = graph.operators[operator].stage.laps;
        Ok(Some(Self {
            publisher: topic.publisher()?,
            since: Instant::now(),
            laps: laps.iter().map(|lap| Metric::new(&format!("{lap}_s"), 0.0)).collect(),
            _topic: topic,
        }))
    }

    /// Connects to everyone who listens.
    pub fn connect(&self) -> Result<(), ShmError> {
        self.publisher.connect()
    }

    /// An activation begins.
    pub fn begin(&mut self) {
        self.laps.iter_mut().for_each(|lap| lap.value = 0.0);
        self.since = Instant::now();
    }

    /// A stage of it has ended.
    pub fn lap(&mut self, lap: usize) {
        let now = Instant::now();
        if let Some(lap) = self.laps.get_mut(lap) {
            lap.value += now.duration_since(self.since).as_secs_f64();
        }
        self.since = now;
    }

    /// Sends the laps of the activation that was committed with this entry. Where the topic's memory is used up they are
    /// lost, and the sequence, which is the activation's index, shows it.
    pub fn send(&self, entry: &Entry) -> Result<(), ShmError> {
        let Some(mut loan) = self.publisher.loan(self.laps.len())? else { return Ok(()) };
        let header = Header { sequence: entry.body.index, count: self.laps.len() as u32, ..entry.header };
        let (meta, payload) = loan.parts_mut();
        meta[..HEADER_SIZE].copy_from_slice(header.as_bytes());
        let bytes = self.laps.as_bytes();
        payload[..bytes.len()].copy_from_slice(bytes);
        self.publisher.send(loan).map(drop)
    }
}
