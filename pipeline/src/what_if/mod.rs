//! What if: a session with a changed pipeline.
//!
//! The part that no change reaches is taken from the recording, to the bit. From the first change on, operators run
//! again on the discrete-event schedule: which samples they would consume is not recorded, because it depends on the
//! change.
//!
//! - `change`: what differs between two pipelines
//! - `reach`: the operators that a change reaches
//! - `feed`: the recorded part, entry by entry
//! - `span`: where a session begins and ends on its time axis

mod change;
mod feed;
mod reach;
mod span;

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use stillpoint_recorder::{Compression, LEDGER_ATTACHMENT, Opening, Session};

pub use change::{Change, changes};
pub use reach::{Reach, WhatIfError};
use span::Span;

use crate::clock::SessionClock;
use crate::files::Snapshot;
use crate::graph::Graph;
use crate::live::RunReport;
use crate::operator::Files;
use crate::replay::{Open, ReplayReport};
use crate::run_source::RunSource;
use crate::schedule::{Events, Latencies, Measured, Observer, RunError};
use crate::session::{IDENTITY, REMARKS, RUN, identity, opening};
use crate::session_recorder::SessionRecorder;
use crate::simulated::Account;
use crate::stdout::StdoutRedirect;
use feed::RecordedPart;

/// Metadata record of a session that was not recorded, but computed from a recording with changes.
pub const WHAT_IF: &str = "stillpoint.what_if";

/// A pipeline, and what it was checked from.
pub struct Checked {
    /// The graph.
    pub graph: Graph,
    /// Its text.
    pub text: String,
    /// Its arguments of `--set`.
    pub sets: Vec<String>,
    /// Variables of the environment that its paths named, with their values.
    pub variables: BTreeMap<String, String>,
    /// The files that it included, with their SHA-256.
    pub included: BTreeMap<String, String>,
    /// The files that its parameters name.
    pub files: Arc<dyn Files + Send + Sync>,
}

/// Which times steps take.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StepTimes {
    /// Those that the session measured; of an operator without any, the declared one.
    #[default]
    Measured,
    /// Those that the pipeline declares.
    Declared,
}

/// How a what-if is done.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Operators that run again though they are not changed.
    pub rerun: Vec<String>,
    /// Operators that are taken from the recording though a change reaches them.
    pub hold: Vec<String>,
    /// Which times steps take.
    pub step_times: StepTimes,
    /// Folder of the session that is written.
    pub folder: PathBuf,
    /// Compression of its chunks.
    pub compression: Compression,
    /// Set by another thread or a signal, it ends the run.
    pub stop: Arc<AtomicBool>,
}

/// What was done.
#[derive(Clone, Debug)]
pub struct WhatIf {
    /// How the run went.
    pub report: RunReport,
    /// What differs between the pipelines.
    pub changes: Vec<Change>,
    /// Which operators ran again, and which were held.
    pub reach: Reach,
    /// Operators whose steps took measured times.
    pub measured: Vec<String>,
    /// How the part that had to be replayed compares with the recording.
    pub replayed: ReplayReport,
}

/// Runs a session with a changed pipeline, and writes the result as a session.
///
/// # Errors
/// The session holds no entry, the options name an operator that there is not, the changed pipeline cannot run, or the
/// session cannot be written.
pub fn what_if(
    session: &Session,
    before: &Checked,
    after: Checked,
    options: &Options,
    observer: &mut dyn Observer,
) -> Result<WhatIf, WhatIfError> {
    let _aside = StdoutRedirect::to_stderr();
    let is_directed =
        session.metadata().get(RUN).and_then(|run| run.get("directed")).is_some_and(|d| d == "true");
    let changes = changes(&before.graph, &after.graph);
    let reach = Reach::of(&after.graph, &changes, options, is_directed)?;
    let span = Span::of(session, &before.graph, is_directed).ok_or(WhatIfError::Empty)?;
    let (latencies, measured) = latencies(session, &after.graph, (&changes, &reach), options.step_times);

    let old = Arc::new(before.graph.clone());
    let mut ran = after.graph;
    let held: BTreeSet<String> =
        ran.operators.iter().map(|o| o.name.clone()).filter(|name| !reach.runs(name)).collect();
    if !is_directed {
        // The far end of a recorded link took its samples from the wire.
        ran.cut(|_, far| held.contains(&far.name));
    }
    let ran = Arc::new(ran);
    let numbers: BTreeSet<usize> =
        ran.operators.iter().enumerate().filter(|(_, o)| reach.runs(&o.name)).map(|(n, _)| n).collect();

    let source = RunSource {
        files: Snapshot::in_memory(&ran, &*after.files)?,
        text: after.text,
        file: session.metadata().get(RUN).and_then(|run| run.get("file")).cloned().unwrap_or_default(),
        sets: after.sets,
        variables: after.variables,
        included: after.included,
    };
    let opening = opening_of(session, &ran, &source, is_directed, &changes, &reach, &measured)?;
    let recorder = SessionRecorder::create(&options.folder, &ran, &opening, options.compression)?;
    let mut account = Account::new(&ran, Some(recorder), observer);
    let mut events =
        Events::new(ran.clone()).deciding(&numbers).taking(latencies).stopped_by(options.stop.clone());
    let mut part =
        RecordedPart::new(session, &old, &*before.files, (&ran, &*after.files), &numbers, is_directed);
    let ended = events.run_fed(&mut part, span.start, span.length(), &mut account);
    let replayed = part.report();
    if let Err(RunError::NotBegun(reason)) = ended {
        crate::session_recorder::remove_folder(&options.folder);
        return Err(WhatIfError::NotBegun(reason));
    }
    let report = account.report(events.end().saturating_sub(span.start), ended)?;
    Ok(WhatIf { report, changes, reach, measured, replayed })
}

impl WhatIf {
    /// The parts of the recorded operators that could not be computed again.
    pub fn open(&self) -> &[Open] {
        &self.replayed.open
    }
}

/// The times of steps, and the operators that run again with measured ones. Of an operator whose latency was changed the
/// measured ones do not hold.
fn latencies(
    session: &Session,
    graph: &Graph,
    (changes, reach): (&[Change], &Reach),
    times: StepTimes,
) -> (Latencies, Vec<String>) {
    if times == StepTimes::Declared {
        return (Latencies::Declared, Vec::new());
    }
    let is_changed =
        |name: &str| changes.iter().any(|change| change.operator == name && change.what == "latency");
    let all: BTreeMap<String, Measured> = graph
        .operators
        .iter()
        .filter(|node| !is_changed(&node.name))
        .filter_map(|node| Some((node.name.clone(), Measured::of(session.journals().get(&node.name)?))))
        .filter(|(_, measured)| !measured.is_empty())
        .collect();
    let measured = all.keys().filter(|name| reach.runs(name)).cloned().collect();
    (Latencies::Measured(all), measured)
}

/// The start of the session that is written: that of a run of this graph, on the clock of the recording, with what was
/// changed.
fn opening_of(
    session: &Session,
    graph: &Graph,
    source: &RunSource,
    is_directed: bool,
    changes: &[Change],
    reach: &Reach,
    measured: &[String],
) -> Result<Opening, WhatIfError> {
    let mut start = opening(graph, source, SessionClock::zero(), is_directed, &identity())?;
    start.clock = session.clock().first().copied();
    if let Some(remarks) = session.metadata().get(REMARKS) {
        start.metadata.insert(REMARKS.to_string(), remarks.clone());
    }
    let recorded_by = session.metadata().get(IDENTITY).and_then(|facts| facts.get("build")).cloned();
    let changes: Vec<String> = changes.iter().map(ToString::to_string).collect();
    let facts = [
        ("changes", changes.join("\n")),
        ("computed", reach.decided.join(", ")),
        ("held", reach.held.join(", ")),
        ("measured_steps", measured.join(", ")),
        ("recorded_by_build", recorded_by.unwrap_or_default()),
    ];
    let facts = facts.into_iter().map(|(key, value)| (key.to_string(), value)).collect();
    start.metadata.insert(WHAT_IF.to_string(), facts);
    start.attachments.retain(|a| a.name != LEDGER_ATTACHMENT);
    Ok(start)
}
