//! When a run is over by itself: all its sources have finished.

use stillpoint_samples::{Cause, Entry, Outcome};

use crate::graph::Graph;
use crate::operator::Role;

/// The operators that have finished.
pub struct Finished {
    message: Vec<bool>,
}

impl Finished {
    /// None yet.
    pub fn new(graph: &Graph) -> Self {
        Self { message: vec![false; graph.operators.len()] }
    }

    /// Takes an entry. A new incarnation starts as not finished.
    pub fn enter(&mut self, operator: usize, entry: &Entry) {
        if entry.cause() == Some(Cause::Start) {
            self.message[operator] = false;
        }
        self.message[operator] |= entry.outcome() == Some(Outcome::Finished);
    }

    /// Whether an operator has finished.
    pub fn has(&self, operator: usize) -> bool {
        self.message[operator]
    }

    /// Whether no operator can send any more: each has finished, or all its producers are over. A source is over only
    /// when it says so; a cycle is never over.
    pub fn is_all(&self, graph: &Graph) -> bool {
        all_over(graph, self.message.clone())
    }
}

impl Graph {
    /// Whether a run ends by itself, as far as parameters say: each source finishes, and so all else is over.
    pub fn ends_by_itself(&self) -> bool {
        all_over(self, self.operators.iter().map(|node| (node.stage.finishes)(&node.params)).collect())
    }
}

/// Whether all operators are over where these have finished.
fn all_over(graph: &Graph, mut over: Vec<bool>) -> bool {
    loop {
        let next = graph.operators.iter().enumerate().find(|(number, node)| {
            let mut producers = node.fed().map(|(_, edge)| edge.operator).peekable();
            !over[*number]
                && node.stage.kind.role == Role::Operator
                && producers.peek().is_some()
                && producers.all(|producer| over[producer])
        });
        match next {
            Some((number, _)) => over[number] = true,
            None => return !over.is_empty() && over.iter().all(|o| *o),
        }
    }
}
