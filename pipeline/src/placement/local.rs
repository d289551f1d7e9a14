//! All operators in this thread.

use std::collections::BTreeSet;
use std::sync::Arc;

use stillpoint_samples::{Entry, JournalRef};

use super::{Begin, Committed, Directed, Placement, PlacementError};
use crate::graph::Graph;
use crate::operator::Files;
use crate::record::Record;
use crate::sample_store::OwnedSample;

/// All operators in this thread.
pub struct Local<'f> {
    graph: Arc<Graph>,
    operators: Vec<Directed>,
    files: &'f dyn Files,
    /// The operators that samples are kept for; `None`: all.
    serving: Option<BTreeSet<usize>>,
}

impl<'f> Local<'f> {
    /// The operators of a graph, without incarnations yet.
    pub fn new(graph: Arc<Graph>, files: &'f dyn Files) -> Self {
        let operators = (0..graph.operators.len()).map(|i| Directed::new(graph.clone(), i)).collect();
        Self { graph, operators, files, serving: None }
    }

    /// The same for activations of these operators alone: samples wait for no others.
    pub fn serving(self, which: BTreeSet<usize>) -> Self {
        Self { serving: Some(which), ..self }
    }

    /// Does one activation, and keeps its outputs from the consumers.
    pub fn activate_alone(&mut self, operator: usize, record: &Record) -> Result<Committed, PlacementError> {
        self.operators[operator].activate(record)
    }

    /// Hands a sample of an output to its consumers.
    pub fn deliver(&mut self, operator: usize, output: usize, owned: &OwnedSample) {
        for (consumer, port) in self.graph.consumers(operator, output) {
            if self.serving.as_ref().is_none_or(|which| which.contains(&consumer)) {
                self.operators[consumer].deliver(port, owned.clone());
            }
        }
    }

    /// Hands a sample to one input.
    pub fn deliver_to(&mut self, operator: usize, port: usize, owned: OwnedSample) {
        self.operators[operator].deliver(port, owned);
    }
}

impl Placement for Local<'_> {
    fn start(&mut self, operator: usize, begin: Begin) -> Result<Entry, PlacementError> {
        self.operators[operator].start(begin, self.files)
    }

    fn activate(&mut self, operator: usize, record: &Record) -> Result<Committed, PlacementError> {
        let committed = self.operators[operator].activate(record)?;
        for (port, owned) in &committed.outputs {
            self.deliver(operator, *port, owned);
        }
        Ok(committed)
    }

    fn end(&mut self, operator: usize, time: u64, inputs: &[JournalRef]) -> Result<Entry, PlacementError> {
        self.operators[operator].end(time, inputs)
    }
}
