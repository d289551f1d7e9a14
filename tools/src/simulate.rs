//! Runs on the discrete-event schedule: simulated, or in lock-step.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use stillpoint_pipeline::clock::SessionClock;
use stillpoint_pipeline::files::Snapshot;
use stillpoint_pipeline::graph::Graph;
use stillpoint_pipeline::ledger::{Ledger, LedgerLine};
use stillpoint_pipeline::live::control::Hello;
use stillpoint_pipeline::live::status::Status;
use stillpoint_pipeline::live::{Fault, Processes, Recorded, RunReport};
use stillpoint_pipeline::placement::{Local, Placement, Threads};
use stillpoint_pipeline::sample_store::OwnedSample;
use stillpoint_pipeline::schedule::{Events, Observer, RunError};
use stillpoint_pipeline::session::{identity, opening};
use stillpoint_pipeline::session_recorder::{SessionRecorder, remove_folder};
use stillpoint_pipeline::setup::Files;
use stillpoint_pipeline::stdout::Aside;
use stillpoint_recorder::Compression;
use stillpoint_samples::Entry;

use crate::exit::Failure;
use crate::pipeline_file::Checked;
use crate::run::launch;

/// Where activations happen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// In this thread.
    Local,
    /// In a thread per operator.
    Threads,
    /// In the processes of the pipeline.
    Processes,
}

/// Runs a checked pipeline for `length` ns of session time, which starts at 0, or until all that feeds it has finished, or
/// until `stop` is set.
pub fn simulate(
    checked: &Checked,
    sets: &[String],
    place: Place,
    length: u64,
    session: Option<(&Path, Compression)>,
    stop: Arc<AtomicBool>,
) -> Result<RunReport, Failure> {
    let _aside = Aside::begin();
    let graph = &checked.graph;
    let file = checked.source.file.display().to_string();
    let snapshot = Snapshot::of(graph, &checked.source.files).map_err(Failure::failed)?;
    let files: Arc<dyn Files + Send + Sync> = Arc::new(snapshot.clone());
    let hello = Hello {
        process: String::new(),
        source: checked.source.text.clone(),
        file: file.clone(),
        sets: sets.to_vec(),
        files: snapshot,
        root: PathBuf::new(),
        prefix: String::new(),
        clock: SessionClock::zero(),
        incarnations: Vec::new(),
        directed: true,
    };
    let mut local;
    let mut threads;
    let mut processes;
    let placement: &mut dyn Placement = match place {
        Place::Local => {
            local = Local::new(graph.clone(), &*files);
            &mut local
        }
        Place::Threads => {
            threads = Threads::new(graph.clone(), &files);
            &mut threads
        }
        Place::Processes => {
            let source = &checked.source;
            processes = Processes::start(graph.clone(), &launch()?, &source.text, &file, sets, &source.files)
                .map_err(Failure::failed)?;
            &mut processes
        }
    };
    let session_recorder = match session {
        None => None,
        Some((session, compression)) => {
            let start = opening(graph, &hello, &identity()).map_err(Failure::failed)?;
            Some(SessionRecorder::create(session, graph, &start, compression).map_err(Failure::failed)?)
        }
    };
    let mut observer = Witnesses {
        graph: graph.clone(),
        session_recorder,
        ledger: Ledger::default(),
        status: Status::new(graph),
        faults: Vec::new(),
        samples: 0,
        bytes: 0,
    };
    let mut events = Events::new(graph.clone()).stopped_by(stop);
    let ended = events.run(placement, 0, length, &mut observer);
    if let Err(RunError::NotBegun(reason)) = &ended {
        // A run that does not begin leaves no session.
        session.into_iter().for_each(|(folder, _)| remove_folder(folder));
        return Err(Failure::failed(reason));
    }
    let ledger = observer.ledger.lines(graph);
    let mut recorded = Vec::new();
    if let Some(session_recorder) = observer.session_recorder {
        let text = serde_json::to_string_pretty(&ledger).map_err(Failure::failed)?;
        let part = match &ended {
            // Who stops a run has it end in order.
            Ok(()) | Err(RunError::Stopped) => session_recorder.finish(Some(text)),
            Err(reason) => session_recorder.finish_early(Some(text), &reason.to_string()),
        };
        let part = part.map_err(Failure::failed)?;
        let lost = std::collections::BTreeMap::new();
        recorded.push(Recorded { part, samples: observer.samples, bytes: observer.bytes, cpu_ns: 0, lost });
    }
    Ok(RunReport {
        pipeline: graph.name.clone(),
        seconds: events.end() as f64 / 1e9,
        operators: observer.status.figures(),
        balanced: ledger.iter().all(LedgerLine::balances),
        ledger,
        unseen_entries: observer.ledger.missing_entries(),
        faults: observer.faults,
        ended_early: ended.err().map(|reason| reason.to_string()),
        recorded,
        recording_failed: None,
        swept: Vec::new(),
    })
}

/// What is kept of a run as it goes on.
struct Witnesses {
    graph: Arc<Graph>,
    session_recorder: Option<SessionRecorder>,
    ledger: Ledger,
    status: Status,
    faults: Vec<Fault>,
    samples: u64,
    bytes: u64,
}

impl Observer for Witnesses {
    fn on_activation(
        &mut self,
        operator: usize,
        entry: &Entry,
        outputs: &[(usize, OwnedSample)],
    ) -> Result<(), String> {
        self.ledger.enter(operator, entry);
        self.status.enter(operator, entry);
        self.samples += 1 + outputs.len() as u64;
        self.bytes += outputs.iter().map(|(_, p)| p.bytes.len() as u64).sum::<u64>();
        match &mut self.session_recorder {
            Some(session_recorder) => session_recorder.on_activation(operator, entry, outputs),
            None => Ok(()),
        }
    }

    fn failed(&mut self, operator: usize, reason: &str) {
        let operator = self.graph.operators[operator].name.clone();
        self.faults.push(Fault { operator, reason: reason.to_string(), fatal: false });
    }
}
