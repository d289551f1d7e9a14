//! Replay: the journal's schedule. Every operator is run again from what it consumed, and what it sends is compared.
//!
//! Each operator is fed recorded samples, so that a difference is named where it arises and damage stays where it is.
//! By induction this equals the closed loop.
//!
//! - `difference`: which field of which sample differs, and by how much
//! - `replayer`: does activations again and compares
//! - `journal`: the entries of all operators in the order of time, and their gaps

mod difference;
mod journal;
mod replayer;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use serde::Serialize;
use stillpoint_recorder::{Session, SessionError};

pub use difference::Difference;
use journal::Ordered;
use replayer::Replayer;

use crate::graph::Graph;
use crate::operator::Role;
use crate::placement::PlacementError;
use crate::schedule::Witness;
use crate::setup::Files;

/// Which operators are compared.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Selection {
    /// All of them.
    All,
    /// This one.
    Only(String),
    /// This one and all downstream of it.
    From(String),
}

/// How a replay went.
#[derive(Clone, Debug, Default, Serialize)]
pub struct ReplayReport {
    /// Activations that were done again.
    pub activations: u64,
    /// By topic: samples compared with the recording, and found the same.
    pub identical: BTreeMap<String, u64>,
    /// By topic: samples that the recording does not hold; they were made again.
    pub recomputed: BTreeMap<String, u64>,
    /// Samples that differ, or were made by no activation.
    pub differences: u64,
    /// The first of them.
    pub first_difference: Option<Difference>,
    /// Incarnations that could not be replayed to their end.
    pub open: Vec<Open>,
    /// Incarnations that were replayed from begin to end.
    pub exact_incarnations: u64,
    /// Session time between the first and the last entry, s.
    pub seconds: f64,
}

/// An incarnation that cannot be replayed from some activation on.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Open {
    /// Name of the operator.
    pub operator: String,
    /// Its incarnation.
    pub incarnation: u32,
    /// The first activation that is not exact.
    pub from_activation: u64,
    /// What is missing.
    pub reason: String,
}

/// Why a session cannot be replayed at all.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The session cannot be read.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// An operator cannot be made or run.
    #[error(transparent)]
    Placement(#[from] PlacementError),
    /// The selection names no operator.
    #[error("the pipeline has no operator `{0}`; it has {1}")]
    Operator(String, String),
    /// What was made again cannot be written.
    #[error("{0}")]
    Witness(String),
}

impl ReplayReport {
    /// Samples compared with the recording, and found the same.
    pub fn compared(&self) -> u64 {
        self.identical.values().sum()
    }

    /// Whether everything that could be compared is the same, and everything could be replayed.
    pub fn is_identical(&self) -> bool {
        self.differences == 0 && self.open.is_empty()
    }
}

/// Replays a session of this graph. `witness` sees every entry with the outputs as they were made again.
pub fn replay(
    session: &Session,
    graph: &Arc<Graph>,
    files: &dyn Files,
    selection: &Selection,
    witness: &mut dyn Witness,
) -> Result<ReplayReport, ReplayError> {
    let compared = selected(graph, selection)?;
    let run = needed(session, graph, &compared);
    let ordered = Ordered::new(session, graph);
    let mut replayer = Replayer::new(session, graph, files, compared, run);
    let seconds = ordered.seconds();
    for (operator, entry, gap) in ordered.entries() {
        replayer.enter(operator, entry, gap, witness)?;
    }
    Ok(ReplayReport { seconds, ..replayer.report() })
}

/// Numbers of the operators that the selection names.
fn selected(graph: &Graph, selection: &Selection) -> Result<BTreeSet<usize>, ReplayError> {
    let find = |name: &str| {
        graph.operator(name).ok_or_else(|| {
            let all: Vec<_> = graph.operators.iter().map(|o| o.name.as_str()).collect();
            ReplayError::Operator(name.to_string(), all.join(", "))
        })
    };
    match selection {
        Selection::All => Ok((0..graph.operators.len()).collect()),
        Selection::Only(name) => Ok(BTreeSet::from([find(name)?])),
        Selection::From(name) => {
            let (mut found, mut todo) = (BTreeSet::new(), vec![find(name)?]);
            while let Some(operator) = todo.pop() {
                if found.insert(operator) {
                    for port in 0..graph.operators[operator].outputs.len() {
                        todo.extend(graph.consumers(operator, port).map(|(c, _)| c));
                    }
                }
            }
            Ok(found)
        }
    }
}

/// The operators that must run: those compared, and those that make what the recording does not hold for them.
fn needed(session: &Session, graph: &Graph, compared: &BTreeSet<usize>) -> BTreeSet<usize> {
    let (mut found, mut todo) = (BTreeSet::new(), compared.iter().copied().collect::<Vec<_>>());
    while let Some(operator) = todo.pop() {
        if graph.operators[operator].stage.kind.role == Role::Source || !found.insert(operator) {
            continue;
        }
        for edge in graph.operators[operator].inputs.iter().filter_map(|i| i.edge) {
            let topic = &graph.operators[edge.operator].outputs[edge.output].topic;
            if session.topic_number(topic).is_none() {
                todo.push(edge.operator);
            }
        }
    }
    found
}
