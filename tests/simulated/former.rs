//! Sessions are replayed with the defaults of their time.

use serde_json::{Value, json};
use stillpoint_operator::files::DiskFiles;
use stillpoint_pipeline::config::check;
use stillpoint_pipeline::former_defaults::former_defaults;
use stillpoint_pipeline::graph::Graph;

use crate::{from_root, registry};

fn graph(sets: &[String]) -> Graph {
    let path = from_root("pipeline.yaml");
    let text = std::fs::read_to_string(&path).unwrap();
    check(&text, "pipeline.yaml", sets, &registry(), &DiskFiles::next_to(&path))
        .unwrap_or_else(|e| panic!("{e}"))
}

fn resolved(graph: &Graph, operator: &str) -> Value {
    graph.operators.iter().find(|o| o.name == operator).unwrap().params.resolved.clone()
}

/// What the graph becomes with the defaults of a session that kept these parameters of head and gate.
fn replayed(head: Value, gate: Value) -> Graph {
    let recorded = [("head".to_owned(), head), ("gate".to_owned(), gate)].into_iter().collect();
    graph(&former_defaults(&graph(&[]), &recorded))
}

#[test]
fn a_session_that_is_older_than_a_parameter_is_replayed_without_it() {
    let old = replayed(json!({}), json!({}));
    assert_eq!(resolved(&old, "head")["soft_tissue"], "ignored");
    assert_eq!(
        (&resolved(&old, "head")["pieces"], &resolved(&graph(&[]), "head")["pieces"]),
        (&json!("off"), &json!("sent"))
    );
    assert_eq!(resolved(&old, "gate")["drift_tolerance"], 10.0);
    assert_eq!(resolved(&graph(&[]), "head")["soft_tissue"], "weighted");
}

#[test]
fn a_session_keeps_what_it_was_recorded_with() {
    let retained = replayed(
        json!({ "soft_tissue": "ignored" }),
        json!({ "drift_tolerance": 0.003, "drift_angle": 0.01 }),
    );
    assert_eq!(resolved(&retained, "head")["soft_tissue"], "ignored");
    let gate = resolved(&retained, "gate");
    assert_eq!((&gate["drift_tolerance"], &gate["drift_angle"]), (&json!(0.003), &json!(0.01)));
    // A session of this build needs nothing.
    let now = graph(&[]);
    let recorded = ["head", "gate"].map(|name| (name.to_owned(), resolved(&now, name))).into_iter().collect();
    assert_eq!(former_defaults(&now, &recorded), [""; 0]);
}
