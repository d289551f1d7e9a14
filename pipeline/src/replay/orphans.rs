//! Recorded samples that no activation made.

use std::collections::{BTreeMap, BTreeSet};

use stillpoint_recorder::{Completeness, Session};
use stillpoint_samples::RefKind;

use super::Difference;
use crate::graph::Graph;

/// Samples of these operators that are recorded, though no entry names them. Only a complete session can tell: where
/// entries are missing, so are their names.
pub fn of_session(session: &Session, graph: &Graph, operators: &BTreeSet<usize>) -> Vec<Difference> {
    if session.completeness() != Completeness::Complete {
        return Vec::new();
    }
    let mut orphans = Vec::new();
    for operator in operators {
        let node = &graph.operators[*operator];
        // By output and incarnation: the activation that sent last, and how many were sent by then. Numbers are given
        // without gaps.
        let mut sent: BTreeMap<(usize, u32), (u64, u64)> = BTreeMap::new();
        for entry in session.journals().get(&node.name).into_iter().flatten() {
            for r in entry.refs_of(RefKind::Output) {
                sent.insert((r.port as usize, entry.header.incarnation), (entry.body.index, r.total));
            }
        }
        for (port, output) in node.outputs.iter().enumerate() {
            let Some(number) = session.topic_number(&output.topic) else { continue };
            for (incarnation, sequence) in session.numbers(number) {
                let (activation, total) = sent.get(&(port, incarnation)).copied().unwrap_or_default();
                if sequence >= total {
                    orphans.push(Difference {
                        operator: node.name.clone(),
                        incarnation,
                        activation,
                        topic: output.topic.clone(),
                        sequence,
                        field: "the whole sample".to_string(),
                        recorded: "a sample".to_string(),
                        replayed: "none: no journal entry names it".to_string(),
                        ulps: None,
                    });
                }
            }
        }
    }
    orphans
}
