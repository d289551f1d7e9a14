//! Frames of a run that gave no result, such as a face, and why, out of a session.

use std::collections::BTreeMap;

use serde::Serialize;
use stillpoint_pipeline::graph::{Graph, OperatorNode};
use stillpoint_pipeline::live::RunReport;
use stillpoint_recorder::Session;
use stillpoint_samples::{Pieces, RefKind, Rejection, Sample};

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
    /// The topic that says why of each.
    pub topic: String,
    /// The commonest reason, in the words of its first frame, and how many frames had it; where the session keeps them.
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

/// The operators that refused frames, by their journals, with the reasons that the session keeps.
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

/// How often which reason was given, by topic and code: one reason has one code, and other numbers in its words each time.
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
