//! The operators that a change reaches: the changed ones, and all that is downstream of them.

use std::collections::BTreeSet;

use serde::Serialize;

use super::{Change, Options};
use crate::files::FileError;
use crate::graph::{Graph, OperatorNode};
use crate::operator::Role;
use crate::placement::PlacementError;
use crate::session::OpeningError;
use crate::session_recorder::SessionError;
use crate::simulated::SimulatedError;

/// Why a session cannot be run with a change.
#[derive(Debug, thiserror::Error)]
pub enum WhatIfError {
    /// The options name an operator that the pipeline has not.
    #[error("the pipeline has no operator `{name}`; it has {all}")]
    Operator {
        /// The name.
        name: String,
        /// The operators that there are.
        all: String,
    },
    /// An operator cannot be changed and held.
    #[error("operator `{0}` is changed, so it cannot be held: change it, or hold it")]
    HeldAndChanged(String),
    /// The session has no journal.
    #[error("the session holds no journal entry, so there is nothing to run again")]
    Empty,
    /// An operator could not be made.
    #[error("{0}")]
    NotBegun(PlacementError),
    /// A file that parameters name.
    #[error(transparent)]
    File(#[from] FileError),
    /// The start of the session that is written cannot be put together.
    #[error(transparent)]
    Opening(#[from] OpeningError),
    /// The session cannot be written.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The session cannot be ended.
    #[error(transparent)]
    End(#[from] SimulatedError),
}

/// What a change reaches.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Reach {
    /// Operators that run again, in the order of the graph.
    pub decided: Vec<String>,
    /// Operators that the change would reach, but which are taken from the recording.
    pub held: Vec<String>,
    /// Simulated patients that run again: what the change does comes back to the sensors.
    pub rigs: Vec<String>,
}

impl Reach {
    /// What these changes of a pipeline reach.
    ///
    /// People and networks do not react to a change: a source that takes from them is held where the session is a live
    /// one, unless it is changed itself. The far end of a link is an edge.
    pub(super) fn of(
        graph: &Graph,
        changes: &[Change],
        options: &Options,
        is_directed: bool,
    ) -> Result<Self, WhatIfError> {
        let number = |name: &String| {
            graph.operator(name).ok_or_else(|| WhatIfError::Operator {
                name: name.clone(),
                all: graph.operators.iter().map(|o| o.name.as_str()).collect::<Vec<_>>().join(", "),
            })
        };
        let held = options.hold.iter().map(number).collect::<Result<BTreeSet<_>, _>>()?;
        let mut first: BTreeSet<usize> = changes.iter().filter_map(|c| graph.operator(&c.operator)).collect();
        if let Some(both) = first.intersection(&held).next() {
            return Err(WhatIfError::HeldAndChanged(graph.operators[*both].name.clone()));
        }
        for name in &options.rerun {
            first.insert(number(name)?);
        }
        let is_held = |operator: usize| {
            held.contains(&operator) || !is_directed && takes_from_outside(&graph.operators[operator])
        };
        let mut reached = BTreeSet::new();
        let mut stopped = BTreeSet::new();
        let mut todo: Vec<usize> = first.iter().copied().collect();
        while let Some(operator) = todo.pop() {
            if is_held(operator) && !first.contains(&operator) {
                stopped.insert(operator);
            } else if reached.insert(operator) {
                for port in 0..graph.operators[operator].outputs.len() {
                    todo.extend(graph.consumers(operator, port).map(|(consumer, _)| consumer));
                }
            }
        }
        let names =
            |which: &BTreeSet<usize>| which.iter().map(|n| graph.operators[*n].name.clone()).collect();
        let is_rig = |n: &&usize| graph.operators[**n].stage.kind.name.starts_with("rig.");
        let rigs = reached.iter().filter(is_rig).copied().collect();
        Ok(Self { decided: names(&reached), held: names(&stopped), rigs: names(&rigs) })
    }

    /// Whether an operator runs again.
    pub fn runs(&self, name: &str) -> bool {
        self.decided.iter().any(|decided| decided == name)
    }
}

/// Whether people, files or a network decide what an operator sends in a live run.
fn takes_from_outside(node: &OperatorNode) -> bool {
    node.stage.kind.role == Role::Source && node.far_end.is_none()
}
