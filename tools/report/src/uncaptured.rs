//! Trackers of a session without a captured reference, and therefore without a pose.

use std::collections::BTreeMap;

use serde::Serialize;
use stillpoint_pipeline::graph::Graph;
use stillpoint_recorder::Session;
use stillpoint_samples::{ConsoleCommand, Pieces, PoseReport, PoseStatus, Sample};

/// A tracker that waited for a capture until the end of the session.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Uncaptured {
    pub operator: String,
    /// Frames that it reported on.
    pub frames: u64,
    /// Frames that were captured and refused as a reference.
    pub unfit: u64,
    /// Frames without a face.
    pub without_a_face: u64,
    /// Commands after which no face was captured in time.
    pub lapsed: u64,
    /// The topic of its commands, if it is connected to one.
    pub command: Option<String>,
}

impl std::fmt::Display for Uncaptured {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { operator, frames, unfit, without_a_face, lapsed, command } = self;
        write!(f, "{operator}: NO REFERENCE was captured, so none of {frames} frames has a pose")?;
        match (unfit, command) {
            (1.., _) => write!(f, "; {unfit} of them were refused as a reference")?,
            (0, Some(topic)) => write!(f, ": stillpoint send {topic} takes the next face")?,
            (0, None) => {}
        }
        if *without_a_face > 0 {
            write!(f, "; {without_a_face} of them show no face")?;
        }
        match lapsed {
            0 => Ok(()),
            1 => write!(f, "; no face was captured in time after the command, send it again"),
            _ => write!(f, "; after {lapsed} commands no face was captured in time, send one again"),
        }
    }
}

/// The trackers of a session that never had a reference, according to their recorded reports.
pub fn of_session(session: &Session, graph: &Graph) -> Vec<Uncaptured> {
    let topics = session.topics();
    let mut waiting: BTreeMap<usize, Option<Uncaptured>> = BTreeMap::new();
    for recorded in session.samples_where(|t| t.type_name == PoseReport::KIND.type_name()).flatten() {
        let Ok(pieces) = Pieces::split(PoseReport::KIND, &recorded.sample) else { continue };
        let Ok(view) = pieces.view::<PoseReport>() else { continue };
        let Some(report) = view.first() else { continue };
        let operator = &topics[recorded.topic].operator;
        let tracker = waiting.entry(recorded.topic).or_insert_with(|| {
            Some(Uncaptured {
                operator: operator.clone(),
                frames: 0,
                unfit: 0,
                without_a_face: 0,
                lapsed: 0,
                command: command_of(graph, operator),
            })
        });
        if report.reference != 0 {
            *tracker = None;
        }
        if let Some(tracker) = tracker {
            let is = |status: PoseStatus| u64::from(report.status == status as u32);
            tracker.frames += 1;
            tracker.unfit += is(PoseStatus::CaptureRefused);
            tracker.without_a_face += is(PoseStatus::NoFace);
            tracker.lapsed += is(PoseStatus::CaptureLapsed);
        }
    }
    waiting.into_values().flatten().collect()
}

/// The topic of an operator's input of commands.
fn command_of(graph: &Graph, operator: &str) -> Option<String> {
    let node = &graph.operators[graph.operator(operator)?];
    let ports = node.stage.kind.inputs.iter();
    let (_, input) = ports.zip(&node.inputs).find(|(port, _)| *port.sample == *ConsoleCommand::KIND)?;
    let edge = input.edge?;
    Some(graph.operators[edge.operator].outputs[edge.output].topic.clone())
}
