//! Frames of a run that gave no result, such as a face, and why, out of a session.

use std::collections::BTreeMap;

use serde::Serialize;
use stillpoint_pipeline::graph::Graph;
use stillpoint_pipeline::live::RunReport;
use stillpoint_recorder::Session;
use stillpoint_samples::{Pieces, Rejection, Sample};

/// Frames of which an operator made nothing.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Refused {
    /// The operator.
    pub operator: String,
    /// What it makes of a frame: the name of its first output.
    pub result: String,
    /// Frames that it was given.
    pub frames: u64,
    /// Frames without a result.
    pub refused: u64,
    /// The commonest reason, in the words of its first frame, and how many frames had it.
    pub reason: (String, u64),
}

impl std::fmt::Display for Refused {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { operator, result, frames, refused, reason: (reason, often) } = self;
        write!(f, "{operator}: {refused} of {frames} frames had no {result}: {reason}")?;
        if often < refused { write!(f, " ({often} of them)") } else { Ok(()) }
    }
}

/// The operators that refused frames, by the rejections that the session keeps.
pub fn of_session(session: &Session, graph: &Graph, report: &RunReport) -> Vec<Refused> {
    let topics = session.topics();
    let mut reasons: BTreeMap<usize, BTreeMap<u32, (String, u64)>> = BTreeMap::new();
    for recorded in session.samples_where(|t| t.type_name == Rejection::KIND.type_name()).flatten() {
        let Ok(pieces) = Pieces::split(Rejection::KIND, &recorded.sample) else { continue };
        let Ok(view) = pieces.view::<Rejection>() else { continue };
        if let Some(rejection) = view.first() {
            let of_topic = reasons.entry(recorded.topic).or_default();
            // One reason has one code, and other numbers in its words each time.
            of_topic.entry(rejection.code).or_insert_with(|| (rejection.reason().to_owned(), 0)).1 += 1;
        }
    }
    let refused = |(topic, reasons): (usize, BTreeMap<u32, (String, u64)>)| {
        let operator = &topics[topic].operator;
        let frames = report.operators.iter().find(|o| o.operator == *operator)?.activations;
        let node = graph.operators.iter().find(|node| node.name == *operator)?;
        Some(Refused {
            operator: operator.clone(),
            result: node.stage.kind.outputs.first()?.name.to_owned(),
            frames,
            refused: reasons.values().map(|(_, often)| often).sum(),
            reason: reasons.into_values().max_by_key(|(_, often)| *often)?,
        })
    };
    reasons.into_iter().filter_map(refused).collect()
}
