//! The supervisor: starts, watches, restarts and ends the processes of a live run.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use serde::Serialize;
use stillpoint_samples::Entry;
use stillpoint_shm::{Domain, Subscriber, Topic};

use super::children::{Child, Launch, Told, wait_any};
use super::contracts;
use super::control::{FromWorker, Hello, HelloRecorder, RecorderReport, ToRecorder, ToWorker};
use super::entry_of;
use super::run_folder::{RunCard, RunFolder, sweep_dead};
use super::status::{OperatorFigures, Status};
use crate::clock::SessionClock;
use crate::graph::{Graph, Restart};
use crate::ledger::{Ledger, Line};

/// How long a child may take to make its ports, and to answer.
const PATIENCE: Duration = Duration::from_secs(60);
/// After this long without a fault, ns, restarts count from zero again.
const CALM: u64 = 10_000_000_000;

/// What is to be run, and how.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// Text of the pipeline.
    pub source: String,
    /// Name of its file.
    pub file: String,
    /// `--set` overrides.
    pub sets: Vec<String>,
    /// Length of the run, ns of session time; `None`: until it is stopped.
    pub duration: Option<u64>,
    /// Folder of the session; `None`: nothing is recorded.
    pub session: Option<PathBuf>,
    /// Compression of the recording: `lz4`, `zstd` or `none`.
    pub compression: String,
    /// How children are started.
    pub launch: Launch,
    /// Facts about build and machine.
    pub identity: BTreeMap<String, String>,
}

/// How a run went.
#[derive(Clone, Debug, Serialize)]
pub struct RunReport {
    /// Name of the pipeline.
    pub pipeline: String,
    /// Session time from go to stop, s.
    pub seconds: f64,
    /// Figures by operator.
    pub operators: Vec<OperatorFigures>,
    /// The ledger.
    pub ledger: Vec<Line>,
    /// Whether every line of the ledger balances.
    pub balanced: bool,
    /// Journal entries that the supervisor did not see (the recorder may have).
    pub unseen_entries: u64,
    /// Failures, in the order in which they were told.
    pub faults: Vec<Fault>,
    /// Why the run ended before its time, if it did.
    pub ended_early: Option<String>,
    /// What was recorded, by part.
    pub recorded: Vec<Recorded>,
    /// Runs that had died, and were swept before this one.
    pub swept: Vec<String>,
}

/// A failure during a run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Fault {
    /// Operator or process.
    pub operator: String,
    /// What it said, or what happened to it.
    pub reason: String,
    /// Whether its process ended by it.
    pub fatal: bool,
}

/// What a part of a session holds.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Recorded {
    /// The file.
    pub part: PathBuf,
    /// Samples, journals included.
    pub samples: u64,
    /// Their bytes.
    pub bytes: u64,
    /// CPU time of the recorder's process, ns; 0 where none of its own wrote the part.
    pub cpu_ns: u64,
    /// Samples not kept, by topic.
    pub lost: BTreeMap<String, u64>,
}

/// Sees how a run goes on.
pub trait Run {
    /// The run goes on: seconds since it began, figures so far.
    fn goes_on(&mut self, seconds: f64, operators: &[OperatorFigures]);
    /// A failure was told.
    fn failed(&mut self, fault: &Fault);
    /// The processes run: process numbers by name.
    fn started(&mut self, processes: &[(String, u32)]);
}

/// Runs a checked pipeline live.
pub struct Supervisor {
    graph: Arc<Graph>,
    options: RunOptions,
    clock: SessionClock,
    workers: Vec<Worker>,
    recorder: Option<Child>,
    recorder_deaths: u32,
    recorded: Vec<Recorded>,
    journals: Vec<Subscriber>,
    ledger: Ledger,
    status: Status,
    /// Highest incarnation seen of each operator.
    lives: Vec<u32>,
    told: Vec<Told>,
    faults: Vec<Fault>,
    swept: Vec<String>,
    epoch: u64,
    // Dropped in this order: ports, then topics, then the node, then the folder.
    _topics: Vec<Topic>,
    domain: Domain,
    folder: RunFolder,
}

struct Worker {
    /// Number of the process.
    process: usize,
    child: Option<Child>,
    /// Restarts since the last calm.
    restarts: u32,
    last_death: u64,
    /// When it is to be started again, session time.
    due: Option<u64>,
}

impl Supervisor {
    /// Sweeps dead runs, lays out shared memory, starts every process and opens the barrier.
    pub fn start(graph: Arc<Graph>, options: RunOptions, run: &mut dyn Run) -> Result<Self, String> {
        let swept = sweep_dead();
        contracts::check_room(&graph)?;
        let folder = RunFolder::create()?;
        let domain =
            Domain::join(&folder.root(), folder.prefix(), "supervisor").map_err(|e| e.to_string())?;
        let mut topics = Vec::new();
        for contract in contracts::all(&graph) {
            topics.push(Topic::create(&domain, &contract).map_err(|e| e.to_string())?);
        }
        let mut journals = Vec::new();
        for operator in 0..graph.operators.len() {
            let name = contracts::journal_topic(&graph.operators[operator].name);
            let topic =
                topics.iter().find(|t| t.contract().topic == name).ok_or("a journal without a topic")?;
            journals.push(topic.subscriber(contracts::JOURNAL_DEPTH).map_err(|e| e.to_string())?);
        }
        let workers = (0..graph.processes.len())
            .map(|process| Worker { process, child: None, restarts: 0, last_death: 0, due: None })
            .collect();
        let mut supervisor = Self {
            status: Status::new(&graph),
            lives: vec![0; graph.operators.len()],
            clock: SessionClock::start(),
            workers,
            recorder: None,
            recorder_deaths: 0,
            recorded: Vec::new(),
            journals,
            ledger: Ledger::default(),
            told: Vec::new(),
            faults: Vec::new(),
            swept,
            epoch: 0,
            _topics: topics,
            domain,
            folder,
            graph,
            options,
        };
        supervisor.open_barrier(run)?;
        Ok(supervisor)
    }

    fn open_barrier(&mut self, run: &mut dyn Run) -> Result<(), String> {
        if self.options.session.is_some() {
            self.start_recorder()?;
        }
        for index in 0..self.workers.len() {
            let child = self.start_worker(index)?;
            self.workers[index].child = Some(child);
        }
        let mut children: Vec<&mut Child> =
            self.workers.iter_mut().filter_map(|w| w.child.as_mut()).collect();
        children.extend(self.recorder.as_mut());
        for child in children {
            let answer = child.answer(PATIENCE, &mut self.told);
            if !matches!(answer, Ok(FromWorker::Made)) {
                let said = self.told.first().map(|t| t.reason.clone());
                return Err(
                    said.unwrap_or_else(|| answer.err().unwrap_or_else(|| "a child is confused".to_string()))
                );
            }
        }
        self.connect_all();
        self.folder.publish(&RunCard {
            pipeline: self.graph.name.clone(),
            pid: std::process::id(),
            source: self.options.source.clone(),
            file: self.options.file.clone(),
            sets: self.options.sets.clone(),
            root: self.folder.root(),
            prefix: self.folder.prefix().to_string(),
        })?;
        run.started(&self.process_numbers());
        self.epoch = self.clock.now();
        let go = ToWorker::Go { epoch: self.epoch };
        for worker in &mut self.workers {
            if let Some(child) = &mut worker.child {
                child.tell(&go);
            }
        }
        Ok(())
    }

    fn process_numbers(&self) -> Vec<(String, u32)> {
        let children = self.workers.iter().filter_map(|w| w.child.as_ref()).chain(&self.recorder);
        children.map(|c| (c.name.clone(), c.pid())).collect()
    }

    fn hello(&self, process: usize) -> Hello {
        let node = self.graph.processes.get(process);
        Hello {
            process: node.map_or_else(|| "recorder".to_string(), |p| p.name.clone()),
            source: self.options.source.clone(),
            file: self.options.file.clone(),
            sets: self.options.sets.clone(),
            root: self.folder.root(),
            prefix: self.folder.prefix().to_string(),
            clock: self.clock,
            incarnations: node
                .map(|p| p.operators.iter().map(|o| self.lives[*o]).collect())
                .unwrap_or_default(),
            directed: false,
        }
    }

    fn start_worker(&self, index: usize) -> Result<Child, String> {
        let process = self.workers[index].process;
        let launch = &self.options.launch;
        Child::start(launch, launch.worker, &self.graph.processes[process].name, &self.hello(process))
    }

    fn start_recorder(&mut self) -> Result<(), String> {
        let Some(session) = self.options.session.clone() else { return Ok(()) };
        let hello = HelloRecorder {
            hello: self.hello(usize::MAX),
            session,
            compression: self.options.compression.clone(),
            identity: self.options.identity.clone(),
        };
        let launch = &self.options.launch;
        self.recorder = Some(Child::start(launch, launch.recorder, "recorder", &hello)?);
        Ok(())
    }

    /// Has every child connect to all publishers that are there, and waits until each has. What a dead publisher sent
    /// is safe only after this.
    fn connect_all(&mut self) {
        for journal in &self.journals {
            let _ = journal.connect();
        }
        let mut asked: Vec<&mut Child> = self.workers.iter_mut().filter_map(|w| w.child.as_mut()).collect();
        for child in &mut asked {
            child.tell(&ToWorker::Connect);
        }
        if let Some(recorder) = &mut self.recorder {
            recorder.tell(&ToRecorder::Connect);
            asked.push(recorder);
        }
        for child in asked {
            // A child that is gone by now is found by the watch; nothing of it is waited for.
            while let Ok(answer) = child.answer(PATIENCE, &mut self.told) {
                if matches!(answer, FromWorker::Connected) {
                    break;
                }
            }
        }
    }

    /// Watches the run until its time is over, it is stopped, or it cannot go on. Then ends it in order.
    pub fn watch(mut self, stop: &AtomicBool, run: &mut dyn Run) -> Result<RunReport, String> {
        let end = self.options.duration.map(|d| self.epoch.saturating_add(d));
        let mut shown = self.epoch;
        let mut early = None;
        loop {
            let now = self.clock.now();
            if end.is_some_and(|end| now >= end) {
                break;
            }
            if stop.load(Ordering::Relaxed) {
                early = Some("stopped".to_string());
                break;
            }
            self.read_journals();
            self.listen();
            self.tell_faults(run);
            if let Some(reason) = self.care_for_children(now)? {
                early = Some(reason);
                break;
            }
            if now - shown >= 250_000_000 {
                shown = now;
                run.goes_on((now - self.epoch) as f64 / 1e9, &self.status.figures());
            }
            let children: Vec<&Child> =
                self.workers.iter().filter_map(|w| w.child.as_ref()).chain(&self.recorder).collect();
            let left = end.map_or(u64::MAX, |end| end.saturating_sub(now)).min(10_000_000);
            wait_any(&children, Duration::from_nanos(left));
        }
        let stopped = self.clock.now();
        self.end(early, stopped, run)
    }

    fn listen(&mut self) {
        let children = self.workers.iter_mut().filter_map(|w| w.child.as_mut()).chain(&mut self.recorder);
        for child in children {
            child.listen(&mut self.told);
        }
    }

    fn tell_faults(&mut self, run: &mut dyn Run) {
        for told in self.told.drain(..) {
            let fault = Fault { operator: told.operator, reason: told.reason, fatal: told.fatal };
            run.failed(&fault);
            self.faults.push(fault);
        }
    }

    /// Takes all journal entries that wait.
    fn read_journals(&mut self) {
        for (operator, journal) in self.journals.iter().enumerate() {
            while let Ok(Some(sample)) = journal.receive() {
                let Some(entry): Option<Entry> = entry_of(sample.pieces()) else { continue };
                self.lives[operator] = self.lives[operator].max(entry.head.incarnation);
                self.ledger.enter(operator, &entry);
                self.status.enter(operator, &entry);
            }
        }
    }

    /// Buries the dead and starts again what is due. Says why the run cannot go on, if it cannot.
    fn care_for_children(&mut self, now: u64) -> Result<Option<String>, String> {
        for index in 0..self.workers.len() {
            if self.workers[index].child.as_ref().is_some_and(Child::is_gone)
                && let Some(reason) = self.bury_worker(index, now)
            {
                return Ok(Some(reason));
            }
        }
        if self.recorder.as_ref().is_some_and(Child::is_gone)
            && let Some(reason) = self.replace_recorder()?
        {
            return Ok(Some(reason));
        }
        for index in 0..self.workers.len() {
            if self.workers[index].due.is_some_and(|due| due <= now) {
                self.restart(index)?;
            }
        }
        Ok(None)
    }

    /// A worker is gone: everyone connects to what it left, its node is cleaned, and its restart is planned.
    fn bury_worker(&mut self, index: usize, now: u64) -> Option<String> {
        let worker = &mut self.workers[index];
        let child = worker.child.take()?;
        let name = child.name.clone();
        let status = child.reap(Duration::from_secs(1));
        let reason =
            format!("process {name} ended: {}", status.map_or("unknown".to_string(), |s| s.to_string()));
        self.faults.push(Fault { operator: name.clone(), reason: reason.clone(), fatal: true });
        self.connect_all();
        self.read_journals();
        self.domain.clean_dead_nodes();
        let worker = &mut self.workers[index];
        if now.saturating_sub(worker.last_death) > CALM {
            worker.restarts = 0;
        }
        worker.last_death = now;
        let last = self.faults.iter().rev().nth(1).filter(|f| f.fatal).map(|f| format!(" ({})", f.reason));
        match self.graph.processes[worker.process].restart {
            Restart::Never => {
                Some(format!("{reason}{}; its restart policy is never", last.unwrap_or_default()))
            }
            Restart::OnFault { limit, .. } if worker.restarts >= limit => {
                Some(format!("{reason}{}; it was restarted {limit} times already", last.unwrap_or_default()))
            }
            Restart::OnFault { backoff, .. } => {
                let wait = backoff.saturating_mul(1 << worker.restarts.min(16));
                worker.restarts += 1;
                worker.due = Some(now.saturating_add(wait));
                None
            }
        }
    }

    /// Starts a worker again. One that dies before its ports are made is buried like any other.
    fn restart(&mut self, index: usize) -> Result<(), String> {
        self.workers[index].due = None;
        for operator in self.graph.processes[self.workers[index].process].operators.clone() {
            self.lives[operator] += 1;
        }
        let mut child = self.start_worker(index)?;
        let made = matches!(child.answer(PATIENCE, &mut self.told), Ok(FromWorker::Made));
        if !made {
            child.kill();
        }
        self.workers[index].child = Some(child);
        if made {
            self.connect_all();
            if let Some(child) = &mut self.workers[index].child {
                child.tell(&ToWorker::Go { epoch: self.epoch });
            }
        }
        Ok(())
    }

    /// A recorder that dies goes on in the next part of the session.
    fn replace_recorder(&mut self) -> Result<Option<String>, String> {
        if let Some(child) = self.recorder.take() {
            let status = child.reap(Duration::from_secs(1));
            let reason =
                format!("the recorder ended: {}", status.map_or("unknown".to_string(), |s| s.to_string()));
            self.faults.push(Fault { operator: "recorder".to_string(), reason, fatal: true });
        }
        self.domain.clean_dead_nodes();
        self.recorder_deaths += 1;
        if self.recorder_deaths > 100 {
            return Ok(Some("the recorder ended again and again".to_string()));
        }
        self.start_recorder()?;
        if let Some(recorder) = &mut self.recorder
            && !matches!(recorder.answer(PATIENCE, &mut self.told), Ok(FromWorker::Made))
        {
            let said = self.told.last().map(|t| t.reason.clone());
            return Ok(Some(said.unwrap_or_else(|| "the recorder cannot be started again".to_string())));
        }
        self.connect_all();
        Ok(None)
    }

    /// Ends the run in order: level by level, the recorder last.
    fn end(mut self, early: Option<String>, stopped: u64, run: &mut dyn Run) -> Result<RunReport, String> {
        for level in levels(&self.graph) {
            for index in &level {
                if let Some(child) = &mut self.workers[*index].child {
                    child.tell(&ToWorker::Stop);
                }
            }
            for index in &level {
                let Some(child) = &mut self.workers[*index].child else { continue };
                let mut answer = child.answer(PATIENCE, &mut self.told);
                while matches!(answer, Ok(ref m) if !matches!(m, FromWorker::Stopped)) {
                    answer = child.answer(PATIENCE, &mut self.told);
                }
                if let Err(reason) = answer {
                    self.told.push(Told {
                        operator: child.name.clone(),
                        incarnation: 0,
                        reason,
                        fatal: true,
                    });
                }
            }
            self.read_journals();
        }
        self.connect_all();
        self.read_journals();
        self.tell_faults(run);
        let ledger = self.ledger.lines(&self.graph);
        let balanced = ledger.iter().all(Line::balances);
        let mut report = RunReport {
            pipeline: self.graph.name.clone(),
            seconds: stopped.saturating_sub(self.epoch) as f64 / 1e9,
            operators: self.status.figures(),
            ledger,
            balanced,
            unseen_entries: self.ledger.missing_entries(),
            faults: Vec::new(),
            ended_early: early,
            recorded: Vec::new(),
            swept: std::mem::take(&mut self.swept),
        };
        self.finish_recording(&report);
        for worker in &mut self.workers {
            if let Some(mut child) = worker.child.take() {
                child.tell(&ToWorker::Exit);
                child.reap(Duration::from_secs(10));
            }
        }
        self.tell_faults(run);
        report.faults = std::mem::take(&mut self.faults);
        report.recorded = std::mem::take(&mut self.recorded);
        Ok(report)
    }

    fn finish_recording(&mut self, report: &RunReport) {
        let Some(mut recorder) = self.recorder.take() else { return };
        let ledger = serde_json::to_string_pretty(&report.ledger).unwrap_or_default();
        recorder.tell(&ToRecorder::Finish {
            ledger,
            gaps: Vec::new(),
            in_order: report.ended_early.as_deref().is_none_or(|e| e == "stopped"),
        });
        loop {
            match recorder.answer(PATIENCE, &mut self.told) {
                Ok(FromWorker::Recorded(RecorderReport { samples, bytes, cpu_ns, lost, part })) => {
                    self.recorded.push(Recorded { part, samples, bytes, cpu_ns, lost });
                    break;
                }
                Ok(_) => {}
                Err(reason) => {
                    let operator = "recorder".to_string();
                    self.told.push(Told { operator, incarnation: 0, reason, fatal: true });
                    break;
                }
            }
        }
        recorder.reap(Duration::from_secs(10));
    }
}

/// Processes by level: each after all that feed it. Processes that feed each other are in one level.
fn levels(graph: &Graph) -> Vec<Vec<usize>> {
    let count = graph.processes.len();
    let mut feeds = vec![BTreeSet::new(); count];
    for node in &graph.operators {
        for edge in node.inputs.iter().filter_map(|i| i.edge) {
            feeds[graph.operators[edge.operator].process].insert(node.process);
        }
    }
    // Reachability is enough for graphs of this size, and gives loops as sets that reach each other.
    let reach: Vec<BTreeSet<usize>> = (0..count)
        .map(|start| {
            let (mut seen, mut todo) = (BTreeSet::new(), vec![start]);
            while let Some(at) = todo.pop() {
                for next in &feeds[at] {
                    if seen.insert(*next) {
                        todo.push(*next);
                    }
                }
            }
            seen
        })
        .collect();
    let mut left: BTreeSet<usize> = (0..count).collect();
    let mut levels = Vec::new();
    while !left.is_empty() {
        // Ready: everything that feeds it and is still left is fed by it, too.
        let ready: Vec<usize> = left
            .iter()
            .copied()
            .filter(|p| left.iter().all(|q| p == q || !reach[*q].contains(p) || reach[*p].contains(q)))
            .collect();
        for p in &ready {
            left.remove(p);
        }
        levels.push(ready);
    }
    levels
}
