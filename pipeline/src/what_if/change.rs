//! What differs between two pipelines.

use std::collections::BTreeSet;

use serde::Serialize;
use serde_json::Value;

use crate::graph::{Graph, InputNode, LateInput, OperatorNode, Restart};
use crate::operator::Policy;

/// What differs about an operator.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Change {
    /// Name of the operator.
    pub operator: String,
    /// The key, or the parameter: `proportional`, `inputs.state`, `use`.
    pub what: String,
    /// Its former value; none of an operator that was added.
    pub before: Option<String>,
    /// Its value now; none of an operator that was removed.
    pub after: Option<String>,
}

impl std::fmt::Display for Change {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { operator, what, before, after } = self;
        match (before, after) {
            (Some(before), Some(after)) => write!(f, "{operator}.{what}: {before} -> {after}"),
            (None, Some(kind)) => write!(f, "{operator}: added ({kind})"),
            (Some(kind), None) => write!(f, "{operator}: removed ({kind})"),
            (None, None) => write!(f, "{operator}.{what}"),
        }
    }
}

/// What differs, in the order of the changed pipeline; the removed operators come last.
pub fn changes(before: &Graph, after: &Graph) -> Vec<Change> {
    let mut found = Vec::new();
    for node in &after.operators {
        match before.operator(&node.name) {
            None => found.push(Change {
                operator: node.name.clone(),
                what: "use".to_string(),
                before: None,
                after: Some(node.stage.kind.name.to_string()),
            }),
            Some(number) => {
                let old = facts(before, &before.operators[number]);
                found.extend(between(&node.name, &old, &facts(after, node)));
            }
        }
    }
    for node in before.operators.iter().filter(|node| after.operator(&node.name).is_none()) {
        found.push(Change {
            operator: node.name.clone(),
            what: "use".to_string(),
            before: Some(node.stage.kind.name.to_string()),
            after: None,
        });
    }
    found
}

/// All that the outputs of an operator depend on beside its inputs, and where these come from: key and value.
fn facts(graph: &Graph, node: &OperatorNode) -> Vec<(String, String)> {
    let mut facts = vec![("use".to_string(), node.stage.kind.name.to_string())];
    flatten("", &node.params.resolved, &mut facts);
    let time = |ns: Option<u64>| ns.map_or("none".to_string(), |ns| format!("{} ms", ns as f64 * 1e-6));
    facts.push(("every".to_string(), time(node.every)));
    facts.push(("latency".to_string(), time(Some(node.latency))));
    facts.push(("deadline".to_string(), time(node.deadline)));
    for (input, port) in node.inputs.iter().zip(node.stage.kind.inputs) {
        facts.push((format!("inputs.{}", port.name), input_text(graph, node, input)));
    }
    for (output, port) in node.outputs.iter().zip(node.stage.kind.outputs) {
        facts.push((format!("frame of {}", port.name), output.frame.clone().unwrap_or("none".to_string())));
    }
    if let Some(process) = graph.processes.get(node.process) {
        facts.push(("restart".to_string(), restart_text(process.restart)));
    }
    // Any operator may draw random numbers, and place one frame in another.
    facts.push(("seed of the pipeline".to_string(), graph.seed.to_string()));
    for (name, frame) in &graph.frames.placed {
        let [x, y, z] = frame.parent_from_frame.translation;
        let turn = frame.parent_from_frame.quaternion();
        let text = format!("in {} at [{x} m, {y} m, {z} m], quaternion {turn:?}", frame.parent);
        facts.push((format!("frames.{name}"), text));
    }
    facts
}

fn input_text(graph: &Graph, node: &OperatorNode, input: &InputNode) -> String {
    let Some(edge) = input.edge else { return "none".to_string() };
    let topic = &graph.operators[edge.operator].outputs[edge.output].topic;
    let policy = match input.policy {
        Policy::Queue(n) => format!("queue: {n}"),
        Policy::Latest => "latest".to_string(),
        Policy::Sync { within } => {
            let leader = input.sync_leader.and_then(|leader| node.stage.kind.inputs.get(leader));
            format!("sync with {} within {} ms", leader.map_or("", |port| port.name), within as f64 * 1e-6)
        }
    };
    let delay =
        if edge.delay == 0 { String::new() } else { format!(", delay {} ms", edge.delay as f64 * 1e-6) };
    let age = input.max_age.map_or(String::new(), |age| {
        let otherwise = match age.otherwise {
            LateInput::Count => "count",
            LateInput::Skip => "skip",
            LateInput::Hold => "hold",
            LateInput::Fault => "fault",
        };
        format!(", max_age {} ms, else {otherwise}", age.max as f64 * 1e-6)
    });
    format!("{topic} ({policy}{delay}{age})")
}

fn restart_text(restart: Restart) -> String {
    match restart {
        Restart::Never => "never".to_string(),
        Restart::OnFault { limit, backoff } => {
            format!("on fault, {limit} times, after {} ms", backoff as f64 * 1e-6)
        }
    }
}

/// The leaves of a value, each with its path.
fn flatten(path: &str, value: &Value, into: &mut Vec<(String, String)>) {
    match value {
        Value::Object(map) => {
            for (key, value) in map {
                let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
                flatten(&path, value, into);
            }
        }
        Value::String(text) => into.push((path.to_string(), text.clone())),
        other => into.push((path.to_string(), other.to_string())),
    }
}

fn between(operator: &str, old: &[(String, String)], new: &[(String, String)]) -> Vec<Change> {
    let value = |of: &[(String, String)], key: &str| {
        of.iter().find(|(k, _)| k == key).map_or("none".to_string(), |(_, value)| value.clone())
    };
    let mut seen = BTreeSet::new();
    let keys = new.iter().chain(old).map(|(key, _)| key).filter(|key| seen.insert((*key).clone()));
    let changed = keys.filter_map(|key| {
        let (before, after) = (value(old, key), value(new, key));
        (before != after).then(|| Change {
            operator: operator.to_string(),
            what: key.clone(),
            before: Some(before),
            after: Some(after),
        })
    });
    changed.collect()
}
