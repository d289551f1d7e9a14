//! A recorded session: its topics, its samples, and what runs again from it.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use serde_json::{Value, json};
use stillpoint::{Rerun, opening_of};
use stillpoint_pipeline::graph::{Graph, Record};
use stillpoint_pipeline::replay::{ReplayError, ReplayReport, Selection, replay};
use stillpoint_pipeline::sample_store::OwnedSample;
use stillpoint_pipeline::schedule::{Observer, ObserverError};
use stillpoint_pipeline::session_recorder::SessionRecorder;
use stillpoint_pipeline::stdout::StdoutRedirect;
use stillpoint_pipeline::what_if::StepTimes;
use stillpoint_recorder::{Completeness, Compression, Role, Session, Topic};
use stillpoint_report::compare::{self, Choice};
use stillpoint_report::pipeline_of;
use stillpoint_samples::{Entry, Pieces};

use crate::error::{raise, raise_failure, raise_rerun};
use crate::interrupt::interruptible;
use crate::registry::registry;
use crate::samples::described;

/// An opened session.
#[pyclass(frozen, name = "NativeSession", module = "stillpoint_rt._native")]
pub struct NativeSession {
    path: PathBuf,
    session: Session,
    /// Whether the code of operators that the session keeps is run.
    trusts: bool,
}

/// Bytes of samples: header and body of each, then the elements of all.
type SampleBytes<'py> = (Bound<'py, PyArray1<u8>>, Bound<'py, PyArray1<u8>>);

#[pymethods]
impl NativeSession {
    /// Opens a folder of parts, or one file.
    #[new]
    fn open(py: Python<'_>, path: PathBuf, trusts: bool) -> PyResult<Self> {
        let session = py.detach(|| Session::open_any(&path)).map_err(raise)?;
        Ok(Self { path, session, trusts })
    }

    /// The topics, as JSON.
    fn topics(&self) -> String {
        json!(self.session.topics().iter().map(topic).collect::<Vec<_>>()).to_string()
    }

    /// Metadata, frames, completeness and the time at which the session begins, as JSON.
    fn about(&self) -> String {
        let gaps = match self.session.completeness() {
            Completeness::Complete => Vec::new(),
            Completeness::Gaps(gaps) => gaps.iter().map(ToString::to_string).collect(),
        };
        let attachments: Vec<&String> = self.session.attachments().keys().collect();
        json!({
            "metadata": self.session.metadata(), "gaps": gaps, "attachments": attachments, "start_ns": self.start_ns(),
        })
        .to_string()
    }

    /// The bytes of an attached file.
    fn attachment<'py>(&self, py: Python<'py>, name: &str) -> Option<Bound<'py, PyBytes>> {
        self.session.attachments().get(name).map(|file| PyBytes::new(py, &file.bytes))
    }

    /// The samples of a topic with a stamp from `from_ns` to before `before_ns`, in the order of recording.
    fn read<'py>(
        &self,
        py: Python<'py>,
        topic: &str,
        from_ns: u64,
        before_ns: u64,
    ) -> PyResult<SampleBytes<'py>> {
        let (meta, elements) = py.detach(|| self.bytes_of(topic, from_ns..before_ns))?;
        Ok((meta.into_pyarray(py), elements.into_pyarray(py)))
    }

    /// Replays the session, one operator (`only`) or one with all downstream of it (`since`). Gives the report as JSON.
    #[pyo3(signature = (only=None, since=None, record=None))]
    fn replay(
        &self,
        py: Python<'_>,
        only: Option<String>,
        since: Option<String>,
        record: Option<PathBuf>,
    ) -> PyResult<String> {
        let selection = match (only, since) {
            (None, None) => Selection::All,
            (Some(name), None) => Selection::Only(name),
            (None, Some(name)) => Selection::From(name),
            (Some(_), Some(_)) => return Err(raise("give `only` or `since`, not both")),
        };
        let report = interruptible(py, |stop| self.replayed(&selection, record, stop))??;
        let mut value = serde_json::to_value(&report).map_err(raise)?;
        value["verdict"] = report.verdict().into();
        value["identical_all"] = (report.is_identical() && !report.compared_nothing()).into();
        Ok(value.to_string())
    }

    /// Runs the session again with changes. Gives what `stillpoint replay --set --json` prints.
    #[pyo3(signature = (sets, with_file=None, rerun=vec![], hold=vec![], declared=false, align="auto", record=None))]
    #[allow(clippy::too_many_arguments)]
    fn what_if(
        &self,
        py: Python<'_>,
        sets: Vec<String>,
        with_file: Option<PathBuf>,
        rerun: Vec<String>,
        hold: Vec<String>,
        declared: bool,
        align: &str,
        record: Option<PathBuf>,
    ) -> PyResult<String> {
        let rerun = Rerun {
            sets,
            with: with_file,
            rerun,
            hold,
            step_times: if declared { StepTimes::Declared } else { StepTimes::Measured },
            align: choice(align)?,
            record,
            compression: Compression::None,
        };
        let computed = interruptible(py, |stop| rerun.compute(&self.session, &registry(self.trusts), stop))?;
        let computed = computed.map_err(raise_rerun)?;
        Ok(computed.to_json(&self.path, rerun.record.as_deref()).to_string())
    }
}

/// Compares two sessions. Gives what `stillpoint diff --json` prints.
#[pyfunction]
pub fn diff(py: Python<'_>, first: &NativeSession, second: &NativeSession, align: &str) -> PyResult<String> {
    let align = choice(align)?;
    let sessions = [&first.session, &second.session];
    let found = py
        .detach(|| compare::of_sessions(sessions, align, &registry(first.trusts && second.trusts)))
        .map_err(raise)?;
    let mut value = serde_json::to_value(&found).map_err(raise)?;
    value["identical_all"] = found.is_identical().into();
    Ok(value.to_string())
}

impl NativeSession {
    /// Time at which the session begins, ns since the epoch: that of the first activation.
    fn start_ns(&self) -> u64 {
        let first = self.session.journals().values().filter_map(|j| j.first()).map(|e| e.header.stamp).min();
        first.or_else(|| self.session.clock().first().map(|c| c.logical_ns)).unwrap_or(0)
    }

    fn bytes_of(&self, topic: &str, time: std::ops::Range<u64>) -> PyResult<(Vec<u8>, Vec<u8>)> {
        let number = self.session.topic_number(topic).ok_or_else(|| {
            let names: Vec<&str> = self.session.topics().iter().map(|t| t.name.as_str()).collect();
            raise(format!("the session has no topic `{topic}`; it has {}", names.join(", ")))
        })?;
        let found = &self.session.topics()[number];
        let kind = found.kind.kind().ok_or_else(|| {
            raise(format!("`{topic}` has samples of type {}, which this build cannot read", found.type_name))
        })?;
        let (mut meta, mut elements) = (Vec::new(), Vec::new());
        for sample in self.session.samples_where(|t| t.name == topic) {
            let sample = sample.map_err(raise)?;
            let pieces = Pieces::split(kind, &sample.sample).map_err(raise)?;
            if time.contains(&pieces.header().stamp) {
                meta.extend_from_slice(pieces.meta);
                elements.extend_from_slice(pieces.payload);
            }
        }
        Ok((meta, elements))
    }

    fn replayed(
        &self,
        selection: &Selection,
        record: Option<PathBuf>,
        stop: Arc<AtomicBool>,
    ) -> PyResult<ReplayReport> {
        let session = &self.session;
        let (graph, files) =
            pipeline_of(session, &registry(self.trusts)).map_err(|e| raise_failure(e.into()))?;
        let graph = Arc::new(graph);
        let recorder = record.map(|folder| {
            let all = Graph { record: Record::All, ..(*graph).clone() };
            SessionRecorder::create(&folder, &all, &opening_of(session), Compression::None)
        });
        let mut observer = Stoppable { recorder: recorder.transpose().map_err(raise)?, stop };
        let _aside = StdoutRedirect::to_stderr();
        let report = replay(session, &graph, &files, selection, &mut observer);
        let report = report.map_err(|error: ReplayError| raise(error))?;
        if let Some(recorder) = observer.recorder {
            recorder.finish(None).map_err(raise)?;
        }
        Ok(report)
    }
}

/// Writes what a replay computes, if a session is written, and ends the replay when the flag is set.
struct Stoppable {
    recorder: Option<SessionRecorder>,
    stop: Arc<AtomicBool>,
}

impl Observer for Stoppable {
    fn on_activation(
        &mut self,
        operator: usize,
        entry: &Entry,
        outputs: &[(usize, OwnedSample)],
    ) -> Result<(), ObserverError> {
        if self.stop.load(Ordering::Relaxed) {
            return Err(ObserverError::Enough("stopped before the end of the session".to_owned()));
        }
        match &mut self.recorder {
            Some(recorder) => recorder.on_activation(operator, entry, outputs),
            None => Ok(()),
        }
    }
}

/// How samples of two sessions are paired.
fn choice(align: &str) -> PyResult<Choice> {
    match align {
        "auto" => Ok(Choice::Auto),
        "sequence" => Ok(Choice::Sequence),
        "origin" => Ok(Choice::Origin),
        other => Err(raise(format!("invalid align: {other} (allowed: auto, sequence, origin)"))),
    }
}

fn topic(topic: &Topic) -> Value {
    let role = match topic.role {
        Role::Journal { .. } => "journal",
        Role::Source => "source",
        Role::Computed => "computed",
        Role::Measured => "measured",
    };
    json!({
        "name": topic.name, "operator": topic.operator, "type": topic.type_name, "frame": topic.frame, "role": role,
        "samples": topic.samples, "bytes": topic.bytes, "kind": topic.kind.kind().map(described),
    })
}
