//! When a run is over by itself: all that feeds it has no more.

use stillpoint_samples::{Cause, Entry, Outcome};

use crate::graph::Graph;
use crate::operator::Role;

/// Which operators have said that they have no more of their own.
pub struct Finished {
    said: Vec<bool>,
}

impl Finished {
    /// None yet.
    pub fn new(graph: &Graph) -> Self {
        Self { said: vec![false; graph.operators.len()] }
    }

    /// Takes an entry. A new incarnation begins anew.
    pub fn enter(&mut self, operator: usize, entry: &Entry) {
        if entry.cause() == Some(Cause::Start) {
            self.said[operator] = false;
        }
        self.said[operator] |= entry.outcome() == Some(Outcome::Finished);
    }

    /// Whether an operator has finished.
    pub fn has(&self, operator: usize) -> bool {
        self.said[operator]
    }

    /// Whether nothing more can come: each operator has finished, or is fed by such as are over, and by nothing else. A
    /// source is over only when it says so; a cycle feeds itself, and never is.
    pub fn is_all(&self, graph: &Graph) -> bool {
        let mut over = self.said.clone();
        loop {
            let next = graph.operators.iter().enumerate().find(|(number, node)| {
                let mut producers = node.inputs.iter().filter_map(|i| i.edge).map(|e| e.operator).peekable();
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
}
