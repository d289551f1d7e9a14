//! Which operators are compared, and which must run for that.

use std::collections::BTreeSet;

use stillpoint_recorder::Session;

use super::ReplayError;
use crate::graph::Graph;
use crate::operator::Role;
use crate::record::Record;

/// Which operators are compared.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Selection {
    /// All operators.
    All,
    /// This one.
    Only(String),
    /// This one and all downstream of it.
    From(String),
}

/// Numbers of the operators that the selection names.
pub(super) fn selected(graph: &Graph, selection: &Selection) -> Result<BTreeSet<usize>, ReplayError> {
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
pub(crate) fn needed(session: &Session, graph: &Graph, compared: &BTreeSet<usize>) -> BTreeSet<usize> {
    let (mut found, mut todo) = (BTreeSet::new(), compared.iter().copied().collect::<Vec<_>>());
    while let Some(operator) = todo.pop() {
        if graph.operators[operator].stage.kind.role == Role::Source || !found.insert(operator) {
            continue;
        }
        let node = &graph.operators[operator];
        for (port, edge) in node.inputs.iter().enumerate().filter_map(|(p, i)| Some((p, i.edge?))) {
            let topic = &graph.operators[edge.operator].outputs[edge.output].topic;
            let runs = found.contains(&edge.operator) || compared.contains(&edge.operator);
            if !runs && !holds_all(session, &node.name, port, topic) {
                todo.push(edge.operator);
            }
        }
    }
    found
}

/// Whether every sample of a topic is recorded that an operator consumed on an input.
fn holds_all(session: &Session, operator: &str, port: usize, topic: &str) -> bool {
    let Some(number) = session.topic_number(topic) else { return false };
    let records = session.journals().get(operator).into_iter().flatten().filter_map(Record::of);
    let mut named = records.flat_map(|r| r.inputs).filter(|r| r.port as usize == port);
    named.all(|r| session.has(number, r.incarnation, r.first))
}
