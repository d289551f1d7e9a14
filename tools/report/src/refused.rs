//! Frames of a session without a result, such as a face, and the reasons.

use std::collections::BTreeMap;

use serde::Serialize;
use stillpoint_pipeline::graph::{Graph, OperatorNode};
use stillpoint_pipeline::live::RunReport;
use stillpoint_recorder::Session;
use stillpoint_samples::{Pieces, RefKind, Rejection, Sample};

/// The frames for which an operator found no result.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Refused {
    pub operator: String,
    /// The name of the result: the first output of the operator.
    pub result: String,
    /// Frames that the operator received.
    pub frames: u64,
    /// Frames without a result.
    pub refused: u64,
    /// The topic with the reason of each refusal.
    pub topic: String,
    /// The most frequent reason, in the words of its first frame, with its count; none if the session keeps no reasons.
    pub reason: Option<(String, u64)>,
}

impl std::fmt::Display for Refused {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { operator, result, frames, refused, topic, reason } = self;
        write!(f, "{operator}: {refused} of {frames} frames had no {result}: ")?;
        match reason {
            Some((reason, often)) if often < refused => write!(f, "{reason} ({often} of them)"),
            Some((reason, _)) => write!(f, "{reason}"),
            None => write!(f, "record {topic} to know why"),
        }
    }
}

/// The operators that refused frames, according to their journals, with the reasons that the session keeps.
pub fn of_session(session: &Session, graph: &Graph, report: &RunReport) -> Vec<Refused> {
    let mut reasons = reasons(session);
    let refused = |node: &OperatorNode| {
        let outputs = &node.stage.kind.outputs;
        let port = outputs.iter().position(|o| o.sample.name == Rejection::KIND.name)?;
        let entries = session.journals().get(&node.name)?.iter();
        let refused = entries
            .flat_map(|entry| entry.refs_of(RefKind::Output))
            .filter(|r| r.port as usize == port)
            .map(|r| u64::from(r.count))
            .sum();
        let topic = format!("{}.{}", node.name, outputs[port].name);
        let reason = reasons.remove(&topic);
        (refused > 0).then(|| Refused {
            operator: node.name.clone(),
            result: outputs[0].name.to_owned(),
            frames: report.operators.iter().find(|o| o.operator == node.name).map_or(0, |o| o.activations),
            refused,
            reason: reason.and_then(|all| all.into_values().max_by_key(|(_, often)| *often)),
            topic,
        })
    };
    graph.operators.iter().filter_map(refused).collect()
}

/// Counts of the reasons by topic and code. A reason has one code, but the numbers in its words differ each time.
fn reasons(session: &Session) -> BTreeMap<String, BTreeMap<u32, (String, u64)>> {
    let mut reasons: BTreeMap<String, BTreeMap<u32, (String, u64)>> = BTreeMap::new();
    for recorded in session.samples_where(|t| t.type_name == Rejection::KIND.type_name()).flatten() {
        let Ok(pieces) = Pieces::split(Rejection::KIND, &recorded.sample) else { continue };
        let Ok(view) = pieces.view::<Rejection>() else { continue };
        if let Some(rejection) = view.first() {
            let of_topic = reasons.entry(session.topics()[recorded.topic].name.clone()).or_default();
            of_topic.entry(rejection.code).or_insert_with(|| (rejection.reason().to_owned(), 0)).1 += 1;
        }
    }
    reasons
}
