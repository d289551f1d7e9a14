//! Runs on the discrete-event schedule: simulated, or in lock-step.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use stillpoint_pipeline::clock::SessionClock;
use stillpoint_pipeline::files::Snapshot;
use stillpoint_pipeline::graph::Graph;
use stillpoint_pipeline::keep::{Keeper, remove_folder};
use stillpoint_pipeline::ledger::{Ledger, Line};
use stillpoint_pipeline::live::control::Hello;
use stillpoint_pipeline::live::status::Status;
use stillpoint_pipeline::live::{Fault, Processes, Recorded, RunReport};
use stillpoint_pipeline::placement::{Local, Placement, Threads};
use stillpoint_pipeline::schedule::{Events, RunError, Witness};
use stillpoint_pipeline::session::{identity, opening};
use stillpoint_pipeline::setup::Files;
use stillpoint_pipeline::shelf::Parcel;
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
    let keeper = match session {
        None => None,
        Some((session, compression)) => {
            let start = opening(graph, &hello, &identity()).map_err(Failure::failed)?;
            Some(Keeper::create(session, graph, &start, compression).map_err(Failure::failed)?)
        }
    };
    let mut witness = Witnesses {
        graph: graph.clone(),
        keeper,
        ledger: Ledger::default(),
        status: Status::new(graph),
        faults: Vec::new(),
        samples: 0,
        bytes: 0,
    };
    let mut events = Events::new(graph.clone()).stopped_by(stop);
    let ended = events.run(placement, 0, length, &mut witness);
    if let Err(RunError::NotBegun(reason)) = &ended {
        // A run that does not begin leaves no session.
        session.into_iter().for_each(|(folder, _)| remove_folder(folder));
        return Err(Failure::failed(reason));
    }
    let ledger = witness.ledger.lines(graph);
    let mut recorded = Vec::new();
    if let Some(keeper) = witness.keeper {
        let text = serde_json::to_string_pretty(&ledger).map_err(Failure::failed)?;
        let part = match &ended {
            // Who stops a run has it end in order.
            Ok(()) | Err(RunError::Stopped) => keeper.finish(Some(text)),
            Err(reason) => keeper.finish_early(Some(text), &reason.to_string()),
        };
        let part = part.map_err(Failure::failed)?;
        let lost = std::collections::BTreeMap::new();
        recorded.push(Recorded { part, samples: witness.samples, bytes: witness.bytes, cpu_ns: 0, lost });
    }
    Ok(RunReport {
        pipeline: graph.name.clone(),
        seconds: events.end() as f64 / 1e9,
        operators: witness.status.figures(),
        balanced: ledger.iter().all(Line::balances),
        ledger,
        unseen_entries: witness.ledger.missing_entries(),
        faults: witness.faults,
        ended_early: ended.err().map(|reason| reason.to_string()),
        recorded,
        recording_failed: None,
        swept: Vec::new(),
    })
}

/// What is kept of a run as it goes on.
struct Witnesses {
    graph: Arc<Graph>,
    keeper: Option<Keeper>,
    ledger: Ledger,
    status: Status,
    faults: Vec<Fault>,
    samples: u64,
    bytes: u64,
}

impl Witness for Witnesses {
    fn saw(&mut self, operator: usize, entry: &Entry, outputs: &[(usize, Parcel)]) -> Result<(), String> {
        self.ledger.enter(operator, entry);
        self.status.enter(operator, entry);
        self.samples += 1 + outputs.len() as u64;
        self.bytes += outputs.iter().map(|(_, p)| p.bytes.len() as u64).sum::<u64>();
        match &mut self.keeper {
            Some(keeper) => keeper.saw(operator, entry, outputs),
            None => Ok(()),
        }
    }

    fn failed(&mut self, operator: usize, reason: &str) {
        let operator = self.graph.operators[operator].name.clone();
        self.faults.push(Fault { operator, reason: reason.to_string(), fatal: false });
    }
}
