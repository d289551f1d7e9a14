//! Defaults that have changed: a session is replayed with those of its time.
//!
//! A session keeps the parameters of its operators as they were resolved. Where a default has changed since, or a parameter
//! is newer than the session, the pipeline's text says nothing of it, and this build would resolve it otherwise.

use serde_json::{Map, Value};

use crate::graph::Graph;

/// A parameter whose default has changed.
struct Changed {
    kind: &'static str,
    param: &'static str,
    /// What holds in a session that does not know the parameter.
    before: &'static str,
    /// The unit of its recorded number.
    unit: &'static str,
}

const CHANGED: &[Changed] = &[
    Changed { kind: "track.head", param: "soft_tissue", before: "ignored", unit: "" },
    // The output is newer than the session, so its journal has no sample of it.
    Changed { kind: "track.head", param: "pieces", before: "off", unit: "" },
    Changed { kind: "gate.beam", param: "drift_tolerance", before: "10 m", unit: "m" },
    Changed { kind: "gate.beam", param: "drift_angle", before: "180 deg", unit: "rad" },
];

/// The `--set` overrides that give the operators of a graph, which was checked by this build, the defaults with which they
/// were recorded. `recorded` are the resolved parameters that the session keeps, by operator.
#[must_use]
pub fn former_defaults(graph: &Graph, recorded: &Map<String, Value>) -> Vec<String> {
    let mut sets = Vec::new();
    for operator in &graph.operators {
        let Some(then) = recorded.get(&operator.name) else { continue };
        for changed in CHANGED.iter().filter(|changed| changed.kind == operator.stage.kind.name) {
            let Changed { param, before, unit, .. } = changed;
            let value = match &then[*param] {
                Value::Null => (*before).to_string(),
                now if *now == operator.params.resolved[*param] => continue,
                Value::String(word) => word.clone(),
                number => format!("{number} {unit}"),
            };
            sets.push(format!("{}.{param}={value}", operator.name));
        }
    }
    sets
}
