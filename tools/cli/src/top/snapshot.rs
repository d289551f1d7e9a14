//! The figures of a run or a session at one time.

use std::path::Path;

use serde::Serialize;
use serde_json::Value;
use stillpoint_pipeline::graph::Graph;
use stillpoint_pipeline::live::status::{OperatorFigures, Status};
use stillpoint_recorder::{Session, session_parts};
use stillpoint_report::contracts::{self, ContractFigures};
use stillpoint_report::hold::{Held, Hold};
use stillpoint_report::trace::{EdgeFigures, Journals, as_run, edges};
use stillpoint_report::unanswered::{Answers, Verdict, figures_of};
use stillpoint_samples::{Cause, Entry, Outcome};

use super::troubles;
use crate::processes::ProcessState;
use crate::settings::{Row, Values};

/// The state at one time.
#[derive(Clone, Debug, Serialize)]
pub struct Snapshot {
    /// The run or session.
    pub of: Value,
    /// Name of the pipeline.
    pub pipeline: String,
    /// The time over which rates and losses were measured, s.
    pub seconds: f64,
    /// What is wrong, in words.
    pub troubles: Vec<String>,
    /// What operators found, in words.
    pub found: Vec<String>,
    /// How the head is held: beam, valves, targets, with their reasons.
    pub held: Option<Held>,
    /// The operators, upstream first.
    pub operators: Vec<OperatorRow>,
    /// The edges.
    pub edges: Vec<EdgeFigures>,
    /// The contracts of the pipeline.
    pub contracts: Vec<ContractFigures>,
    /// The processes of a run; none of a session.
    pub processes: Vec<ProcessRow>,
    /// Parameters that were changed while their operators run.
    pub changed: Vec<Row>,
    /// The recording, where there is one.
    pub recorder: Option<RecorderRow>,
    /// Of a run: how far the clock of this machine was set ahead since its start, s. Session time does not follow it.
    pub clock_set_s: Option<f64>,
}

/// An operator.
#[derive(Clone, Debug, Serialize)]
pub struct OperatorRow {
    /// Its name.
    pub operator: String,
    /// Its process.
    pub process: String,
    /// `running`, `waiting` (nothing to do), `silent` (its timer stands), `failing`, `finished`, `suspended`, `down`, `ended`
    /// or `unended`.
    pub state: &'static str,
    /// Its figures.
    #[serde(flatten)]
    pub figures: OperatorFigures,
    /// Times that it was restarted since the run began.
    pub restarts: u32,
    /// Share of a core that its process takes, per cent.
    pub cpu_percent: Option<f64>,
    /// Memory of its process.
    pub memory_bytes: Option<u64>,
}

/// A process of a run.
#[derive(Clone, Debug, Serialize)]
pub struct ProcessRow {
    /// As the system sees it.
    #[serde(flatten)]
    pub state: ProcessState,
    /// Share of a core that it takes, per cent.
    pub cpu_percent: Option<f64>,
    /// Share of the time in which it was ready and got no core, per cent.
    pub delayed_percent: Option<f64>,
    /// The scheduling class that the pipeline asks for.
    pub asked: String,
}

/// A recording.
#[derive(Clone, Debug, Serialize)]
pub struct RecorderRow {
    /// Its folder.
    pub session: String,
    /// Bytes on disk.
    pub bytes: u64,
    /// Bytes that are free on its disk.
    pub free_bytes: Option<u64>,
}

impl RecorderRow {
    /// The recording in this folder.
    pub fn of(session: &Path) -> Self {
        let parts = session_parts(session).unwrap_or_default();
        Self {
            session: session.display().to_string(),
            bytes: parts.iter().filter_map(|p| p.metadata().ok()).map(|m| m.len()).sum(),
            free_bytes: rustix::fs::statvfs(session).ok().map(|f| f.f_bavail.saturating_mul(f.f_frsize)),
        }
    }
}

/// What a snapshot is made from.
pub struct Parts<'a> {
    /// The run or session, as commands name it.
    pub of: Value,
    /// The graph, as it runs or ran.
    pub graph: &'a Graph,
    /// Its journals over the time of the snapshot.
    pub journals: Journals<'a>,
    /// The figures of its operators over that time.
    pub figures: Vec<OperatorFigures>,
    /// The time, s.
    pub seconds: f64,
    /// How the head is held.
    pub held: Option<Held>,
    /// What operators answered.
    pub verdict: Verdict,
    /// The processes of a run.
    pub processes: Option<Vec<ProcessRow>>,
    /// Parameters that were changed while their operators run.
    pub changed: Vec<Row>,
    /// The recording.
    pub recorder: Option<RecorderRow>,
    /// See [`Snapshot`].
    pub clock_set_s: Option<f64>,
}

impl Snapshot {
    /// The snapshot of the parts.
    pub fn of(parts: Parts<'_>) -> Self {
        let Parts {
            of,
            graph,
            journals,
            figures,
            seconds,
            held,
            verdict,
            processes,
            changed,
            recorder,
            clock_set_s,
        } = parts;
        let operators: Vec<OperatorRow> = graph
            .operators
            .iter()
            .zip(figures)
            .map(|(node, figures)| {
                let name = &graph.processes[node.process].name;
                let process = processes.as_ref().map(|all| all.iter().find(|p| p.state.name == *name));
                let entries = journals.operators.iter().find(|o| o.stage.name == node.name);
                let entries = entries.map_or(&[][..], |o| o.entries);
                OperatorRow {
                    operator: node.name.clone(),
                    process: name.clone(),
                    state: state(process, entries, node.every.is_some()),
                    restarts: entries.last().map_or(0, |e| e.header.incarnation),
                    cpu_percent: process.flatten().and_then(|p| p.cpu_percent),
                    memory_bytes: process.flatten().map(|p| p.state.memory_bytes),
                    figures,
                }
            })
            .collect();
        let mut snapshot = Self {
            of,
            pipeline: graph.name.clone(),
            seconds,
            troubles: Vec::new(),
            found: verdict.found,
            held,
            operators,
            edges: edges(&journals),
            contracts: contracts::of(graph, &journals),
            processes: processes.unwrap_or_default(),
            changed,
            recorder,
            clock_set_s,
        };
        snapshot.troubles = troubles::of(&snapshot, graph, &journals);
        let unanswered = verdict.unanswered.into_iter().map(|what| format!("no answer: {what}"));
        snapshot.troubles.extend(unanswered);
        snapshot
    }

    /// The snapshot of a whole session of this pipeline.
    pub fn of_session(of: Value, path: &Path, session: &Session, graph: &Graph) -> Self {
        let ran = as_run(graph, session);
        let journals = Journals::of_session(session, Some(&ran));
        let figures = figures_of(session, &ran);
        Self::of(Parts {
            of,
            graph: &ran,
            seconds: journals.seconds(),
            held: Hold::of_session(&ran, session),
            verdict: Answers::of_session(&ran, session).verdict(&ran, &figures),
            processes: None,
            changed: Values::of_session(session, &ran).changed(&ran),
            recorder: Some(RecorderRow { free_bytes: None, ..RecorderRow::of(path) }),
            clock_set_s: None,
            figures,
            journals,
        })
    }
}

/// The state of an operator. `process`: what is known of its process, in a run.
fn state(process: Option<Option<&ProcessRow>>, entries: &[Entry], has_timer: bool) -> &'static str {
    let last = entries.last();
    let is_ended = last.is_some_and(|e| e.cause() == Some(Cause::End));
    match (process, last) {
        (Some(None), _) => "down",
        (Some(Some(process)), _) if process.state.suspended => "suspended",
        (None, _) if is_ended => "ended",
        (None, _) => "unended",
        (Some(Some(_)), None) if has_timer => "silent",
        (Some(Some(_)), None) => "waiting",
        (Some(Some(_)), Some(last)) => match last.outcome() {
            _ if is_ended => "ended",
            Some(Outcome::Error | Outcome::Panic) => "failing",
            Some(Outcome::Finished) => "finished",
            _ => "running",
        },
    }
}

/// The figures of operators over the entries of a time, by number of the operator.
pub fn figures(graph: &Graph, entries: &[Vec<Entry>]) -> Vec<OperatorFigures> {
    let mut status = Status::new(graph);
    for (operator, entries) in entries.iter().enumerate() {
        entries.iter().for_each(|entry| status.enter(operator, entry));
    }
    status.figures()
}
