//! Runs on the discrete-event schedule: simulated, or in lock-step. What the command does and what tests do is the same.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use stillpoint_recorder::Compression;
use stillpoint_samples::Entry;

use crate::clock::SessionClock;
use crate::graph::Graph;
use crate::ledger::{Ledger, LedgerLine};
use crate::live::status::Status;
use crate::live::{Fault, Launch, LiveError, Processes, Recorded, RunReport};
use crate::operator::Files;
use crate::placement::{Local, Placement, PlacementError, Threads};
use crate::run_source::RunSource;
use crate::sample_store::OwnedSample;
use crate::schedule::{Events, Observer, ObserverError, RunError};
use crate::session::{OpeningError, opening};
use crate::session_recorder::{SessionError, SessionRecorder, remove_folder};
use crate::stdout::StdoutRedirect;

/// Where the activations of a simulated run happen.
#[derive(Clone, Debug)]
pub enum Place {
    /// In this thread.
    Local,
    /// In a thread per operator.
    Threads,
    /// In the processes of the pipeline.
    Processes(Launch),
}

/// How a simulated run is done.
#[derive(Clone, Debug)]
pub struct SimulatedOptions {
    /// Where activations happen.
    pub place: Place,
    /// Length of the run, ns of session time, which starts at 0.
    pub length: u64,
    /// Folder of the session and how its chunks are compressed; `None`: nothing is recorded.
    pub session: Option<(PathBuf, Compression)>,
    /// Facts about build and machine, for the session's metadata.
    pub identity: BTreeMap<String, String>,
    /// Set by another thread or a signal, it ends the run in order; set again, it ends the wait for what is under way.
    pub stop: Arc<AtomicBool>,
}

/// Why there is no report of a simulated run.
#[derive(Debug, thiserror::Error)]
pub enum SimulatedError {
    /// The processes of the run did not begin; there is no session.
    #[error(transparent)]
    Processes(#[from] LiveError),
    /// An operator could not be made; there is no session.
    #[error(transparent)]
    NotBegun(PlacementError),
    /// The session could not be begun; there is none.
    #[error(transparent)]
    NoSession(SessionError),
    /// What the session would say of its run cannot be put together, such as a file that params name.
    #[error(transparent)]
    Opening(#[from] OpeningError),
    /// The session could not be ended.
    #[error(transparent)]
    Session(SessionError),
    /// The ledger cannot be written as JSON.
    #[error("{0}")]
    Ledger(serde_json::Error),
}

/// Runs a graph, which was checked from `source`, until its time is over, or all that feeds it has finished, or it is
/// stopped, or an operator failed and the restart policy ends the run.
///
/// While it runs, what operators print goes to standard error. `observer` sees every activation after the session has it.
///
/// # Errors
/// See [`SimulatedError`]. A run that began and ended early has a report that says why.
pub fn simulate(
    graph: &Arc<Graph>,
    source: &RunSource,
    options: SimulatedOptions,
    observer: &mut dyn Observer,
) -> Result<RunReport, SimulatedError> {
    let _aside = StdoutRedirect::to_stderr();
    let files: Arc<dyn Files + Send + Sync> = Arc::new(source.files.clone());
    let (mut local, mut threads, mut processes);
    let placement: &mut dyn Placement = match &options.place {
        Place::Local => {
            local = Local::new(graph.clone(), &*files);
            &mut local
        }
        Place::Threads => {
            threads = Threads::new(graph.clone(), &files).map_err(SimulatedError::NotBegun)?;
            &mut threads
        }
        Place::Processes(launch) => {
            processes = Processes::start(graph.clone(), launch, source)?;
            &mut processes
        }
    };
    let session_recorder = match &options.session {
        None => None,
        Some((folder, compression)) => {
            let start = opening(graph, source, SessionClock::zero(), true, &options.identity)?;
            let recorder = SessionRecorder::create(folder, graph, &start, *compression);
            Some(recorder.map_err(SimulatedError::NoSession)?)
        }
    };
    let mut account = Account::new(graph, session_recorder, observer);
    let mut events = Events::new(graph.clone()).stopped_by(options.stop);
    let ended = events.run(placement, 0, options.length, &mut account);
    if let Err(RunError::NotBegun(reason)) = ended {
        // A run that does not begin leaves no session.
        options.session.iter().for_each(|(folder, _)| remove_folder(folder));
        return Err(SimulatedError::NotBegun(reason));
    }
    account.report(events.end(), ended)
}

/// What is kept of a run as it goes on.
pub(crate) struct Account<'a> {
    graph: Arc<Graph>,
    session_recorder: Option<SessionRecorder>,
    observer: &'a mut dyn Observer,
    ledger: Ledger,
    status: Status,
    faults: Vec<Fault>,
    samples: u64,
    bytes: u64,
}

impl<'a> Account<'a> {
    /// Nothing yet, of a run of this graph that is recorded there, if anywhere.
    pub(crate) fn new(
        graph: &Arc<Graph>,
        session_recorder: Option<SessionRecorder>,
        observer: &'a mut dyn Observer,
    ) -> Self {
        Self {
            graph: graph.clone(),
            session_recorder,
            observer,
            ledger: Ledger::default(),
            status: Status::new(graph),
            faults: Vec::new(),
            samples: 0,
            bytes: 0,
        }
    }

    /// Ends the session, and says how the run went that lasted until `end`, ns of session time since its start.
    pub(crate) fn report(self, end: u64, ended: Result<(), RunError>) -> Result<RunReport, SimulatedError> {
        let ledger = self.ledger.lines(&self.graph);
        let mut recorded = Vec::new();
        if let Some(session_recorder) = self.session_recorder {
            let text = serde_json::to_string_pretty(&ledger).map_err(SimulatedError::Ledger)?;
            let part = match &ended {
                // A run that somebody stops ends in order.
                Ok(()) | Err(RunError::Stopped) => session_recorder.finish(Some(text)),
                Err(reason) => session_recorder.finish_early(Some(text), &reason.to_string()),
            };
            let part = part.map_err(SimulatedError::Session)?;
            let (samples, bytes) = (self.samples, self.bytes);
            recorded.push(Recorded { part, samples, bytes, cpu_ns: 0, lost: BTreeMap::new() });
        }
        Ok(RunReport {
            pipeline: self.graph.name.clone(),
            seconds: end as f64 / 1e9,
            operators: self.status.figures(),
            balanced: ledger.iter().all(LedgerLine::balances),
            ledger,
            unseen_entries: self.ledger.missing_entries(),
            faults: self.faults,
            ended_early: ended.err().map(|reason| reason.to_string()),
            recorded,
            recording_failed: None,
            swept: Vec::new(),
        })
    }
}

impl Observer for Account<'_> {
    fn on_activation(
        &mut self,
        operator: usize,
        entry: &Entry,
        outputs: &[(usize, OwnedSample)],
    ) -> Result<(), ObserverError> {
        self.ledger.enter(operator, entry);
        self.status.enter(operator, entry);
        self.samples += 1 + outputs.len() as u64;
        self.bytes += outputs.iter().map(|(_, p)| p.bytes.len() as u64).sum::<u64>();
        if let Some(session_recorder) = &mut self.session_recorder {
            session_recorder.on_activation(operator, entry, outputs)?;
        }
        self.observer.on_activation(operator, entry, outputs)
    }

    fn failed(&mut self, operator: usize, reason: &str) {
        let operator = self.graph.operators[operator].name.clone();
        self.faults.push(Fault { operator, reason: reason.to_string(), fatal: false });
    }
}
