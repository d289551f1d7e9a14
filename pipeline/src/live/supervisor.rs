//! The supervisor: starts, watches, restarts and ends the processes of a live run.
//!
//! - `connecting`: which processes connect to which, and how long the supervisor waits
//! - `requests`: restarts that people ask for, and the changes of parameters that a restarted process begins with
//! - `restarts`: what follows on the death of a child
//! - `ending`: the end of a run, level by level

mod connecting;
mod ending;
mod requests;
mod restarts;

pub use requests::REFUSED;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use stillpoint_samples::Entry;
use stillpoint_shm::{Domain, Subscriber, Topic};

use super::affinity::scheduling;
use super::barrier::wait_until_made;
use super::bridge::{BridgeAccounts, HelloBridge, bridge_launch, identity_of};
use super::children::{Child, ChildError, Launch, ReportedFault, wait_any};
use super::contracts;
use super::control::{Hello, HelloRecorder, ToWorker};
use super::error::LiveError;
use super::journal::entry_of;
use super::log::{Level, Log, LogLine};
use super::report::{Fault, Run, RunOptions, RunReport};
use super::reservation::{Retention, reserve};
use super::run_folder::{RunCard, RunFolder, sweep_dead};
use super::status::Status;
use crate::clock::SessionClock;
use crate::files::Snapshot;
use crate::finished::Finished;
use crate::graph::Graph;
use crate::ledger::Ledger;
use crate::restarts::Restarts;
use crate::run_source::RunSource;

/// Runs a checked pipeline live.
pub struct Supervisor {
    graph: Arc<Graph>,
    options: RunOptions,
    clock: SessionClock,
    workers: Vec<Worker>,
    recorder: Option<Child>,
    recorder_deaths: u32,
    recorder_restarts: Restarts,
    /// Why the recorder that died last did.
    recorder_exit: Option<String>,
    /// When the recorder is to be started again, session time.
    recorder_due: Option<u64>,
    /// Number of the last order to connect.
    connects: u64,
    dead: Vec<restarts::Dead>,
    /// When dead programs that had attached are looked for next, session time.
    visitors_due: u64,
    journals: Vec<Subscriber>,
    requests: requests::Requests,
    ledger: Ledger,
    /// How the bridge is started, where this part has one, and all that it needs to know.
    bridge: Option<(Launch, HelloBridge)>,
    bridged: BridgeAccounts,
    status: Status,
    finished: Finished,
    /// Highest incarnation seen of each operator.
    incarnations: Vec<u32>,
    reported: Vec<ReportedFault>,
    log: Log,
    faults: Vec<Fault>,
    swept: Vec<String>,
    epoch: u64,
    source: RunSource,
    // Dropped in this order: ports, then topics, then the node, then the folder.
    _topics: Vec<Topic>,
    domain: Domain,
    folder: RunFolder,
}

struct Worker {
    /// Number of the process.
    process: usize,
    child: Option<Child>,
    /// It was told to begin.
    went: bool,
    /// Number of the order to connect that went before.
    greeted: u64,
    /// What follows on its death, or on a panic of one of its operators.
    restarts: Restarts,
    /// When it is to be started again, session time.
    due: Option<u64>,
}

impl Supervisor {
    /// Sweeps dead runs, lays out shared memory, starts every process and opens the barrier. `stop` ends that, too.
    pub fn start(
        graph: Arc<Graph>,
        options: RunOptions,
        stop: &AtomicBool,
        run: &mut dyn Run,
    ) -> Result<Self, LiveError> {
        let graph = Arc::new(Graph::clone(&graph).live());
        let launch = if graph.has_bridge() { Some(bridge_launch(&options.launch)?) } else { None };
        let swept = sweep_dead()?;
        let folder = RunFolder::create()?;
        let retained = if options.session.is_some() { Retention::Newest } else { Retention::Nothing };
        let contracts = reserve(&graph, retained, &folder)?;
        let source = RunSource {
            text: options.source.clone(),
            file: options.file.clone(),
            sets: options.sets.clone(),
            variables: options.variables.clone(),
            included: options.included.clone(),
            files: Snapshot::of(&graph, &options.files).and_then(|files| files.copied_to(&folder.files()))?,
        };
        let clock = SessionClock::start();
        let domain = Domain::create(&folder.root(), folder.prefix(), "supervisor")?;
        let mut topics = Vec::new();
        for contract in &contracts {
            topics.push(Topic::create(&domain, contract)?);
        }
        let mut journals = Vec::new();
        for operator in 0..graph.operators.len() {
            let name = contracts::journal_topic(&graph.operators[operator].name);
            let topic =
                topics.iter().find(|t| t.contract().topic == name).ok_or(LiveError::NoJournal(name))?;
            journals.push(topic.subscriber(contracts::JOURNAL_DEPTH)?);
        }
        let requests = requests::Requests::open(&graph, &topics)?;
        let identity = identity_of(&graph, &source);
        let hello = HelloBridge::of(&graph, identity, folder.root(), folder.prefix().to_owned(), clock);
        let bridge = launch.zip(hello.map(|hello| hello.with_files_of(&options.files)));
        let workers = (0..graph.processes.len())
            .map(|process| Worker {
                process,
                child: None,
                went: false,
                greeted: 0,
                restarts: restarts::of_process(&graph.processes[process]),
                due: None,
            })
            .collect();
        let mut supervisor = Self {
            status: Status::new(&graph),
            finished: Finished::new(&graph),
            incarnations: vec![0; graph.operators.len()],
            clock,
            bridge,
            bridged: BridgeAccounts::default(),
            workers,
            recorder: None,
            recorder_deaths: 0,
            recorder_restarts: restarts::of_recorder(),
            recorder_exit: None,
            recorder_due: None,
            connects: 0,
            dead: Vec::new(),
            visitors_due: 0,
            journals,
            requests,
            ledger: Ledger::default(),
            reported: Vec::new(),
            log: Log::default(),
            faults: Vec::new(),
            swept,
            epoch: 0,
            source,
            _topics: topics,
            domain,
            folder,
            graph,
            options,
        };
        supervisor.open_barrier(stop, run)?;
        Ok(supervisor)
    }

    fn open_barrier(&mut self, stop: &AtomicBool, run: &mut dyn Run) -> Result<(), LiveError> {
        if self.options.session.is_some() {
            self.start_recorder()?;
        }
        for index in 0..self.workers.len() {
            let child = self.start_worker(index)?;
            self.workers[index].child = Some(child);
        }
        let children = self.workers.iter_mut().filter_map(|w| w.child.as_mut()).chain(&mut self.recorder);
        let is_stopped = || stop.load(Ordering::Relaxed);
        wait_until_made(children, &mut self.reported, is_stopped)?;
        let number = self.connect_all();
        self.wait_for_recorder(number, || stop.load(Ordering::Relaxed));
        self.folder.publish(&RunCard {
            pipeline: self.graph.name.clone(),
            pid: std::process::id(),
            clock: self.clock,
            source: self.source.text.clone(),
            file: self.source.file.clone(),
            sets: self.source.sets.clone(),
            files: self.source.files.clone(),
            root: self.folder.root(),
            prefix: self.folder.prefix().to_string(),
            session: self.options.session.as_ref().and_then(|s| std::path::absolute(s).ok()),
        })?;
        self.log = Log::begin(self.folder.path(), self.options.session.as_deref());
        for (process, pid) in self.process_numbers() {
            let granted = scheduling(pid);
            self.say(Level::Info, &process, format!("runs as process {pid}, scheduled as {granted}"));
        }
        run.started(&self.process_numbers());
        self.epoch = self.clock.now();
        let go = ToWorker::Go { epoch: self.epoch };
        for worker in &mut self.workers {
            if let Some(child) = &mut worker.child {
                child.send_message(&go);
                (worker.went, worker.greeted) = (true, number);
            }
        }
        Ok(())
    }

    /// Writes a line into the log.
    fn say(&mut self, level: Level, operator: &str, message: String) {
        let line = LogLine { time: self.clock.now(), level, operator: operator.to_owned(), message };
        self.log.write(&line);
    }

    fn process_numbers(&self) -> Vec<(String, u32)> {
        let children = self.workers.iter().filter_map(|w| w.child.as_ref()).chain(&self.recorder);
        children.map(|c| (c.name.clone(), c.pid())).collect()
    }

    fn hello(&self, process: usize) -> Hello {
        let node = self.graph.processes.get(process);
        Hello {
            process: node.map_or_else(|| "recorder".to_string(), |p| p.name.clone()),
            source: self.source.clone(),
            root: self.folder.root(),
            prefix: self.folder.prefix().to_string(),
            clock: self.clock,
            incarnations: node
                .map(|p| p.operators.iter().map(|o| self.incarnations[*o]).collect())
                .unwrap_or_default(),
            changes: node
                .map(|p| p.operators.iter().map(|o| self.requests.changes(*o)).collect())
                .unwrap_or_default(),
            directed: false,
        }
    }

    fn start_worker(&mut self, index: usize) -> Result<Child, ChildError> {
        let process = self.workers[index].process;
        if self.graph.processes[process].operators.is_empty()
            && let Some((launch, hello)) = &self.bridge
        {
            self.bridged.begin();
            return Child::start(launch, launch.worker, &self.graph.processes[process].name, hello);
        }
        let launch = &self.options.launch;
        Child::start(launch, launch.worker, &self.graph.processes[process].name, &self.hello(process))
    }

    fn start_recorder(&mut self) -> Result<(), ChildError> {
        let Some(session) = self.options.session.clone() else { return Ok(()) };
        let hello = HelloRecorder {
            hello: self.hello(usize::MAX),
            session,
            compression: self.options.compression,
            identity: self.options.identity.clone(),
        };
        let launch = &self.options.launch;
        self.recorder = Some(Child::start(launch, launch.recorder, "recorder", &hello)?);
        Ok(())
    }

    /// Watches the run until its time is over, all that feeds it has finished, it is stopped, or it cannot go on. Then
    /// ends it in order.
    pub fn watch(mut self, stop: &AtomicBool, run: &mut dyn Run) -> RunReport {
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
            if self.finished.is_all(&self.graph) {
                break;
            }
            self.listen();
            self.attend_requests();
            self.report_faults(run);
            // A child that cannot be started ends the run, too, and in order.
            if let Some(reason) = self.attend_children(now).unwrap_or_else(|e| Some(e.to_string())) {
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
        self.end(early, stopped, stop, run)
    }

    fn listen(&mut self) {
        let children = self.workers.iter_mut().filter_map(|w| w.child.as_mut()).chain(&mut self.recorder);
        for child in children {
            child.listen(&mut self.reported);
        }
        self.take_counts();
    }

    /// Takes what the bridge has told of its counts.
    fn take_counts(&mut self) {
        for child in self.workers.iter_mut().filter_map(|w| w.child.as_mut()) {
            child.bridged.take().into_iter().for_each(|report| self.bridged.enter(report));
        }
    }

    fn report_faults(&mut self, run: &mut dyn Run) {
        let time = self.clock.now();
        for child in self.workers.iter_mut().filter_map(|w| w.child.as_mut()) {
            child.logged.drain(..).for_each(|line| self.log.write(&line));
            for news in child.news.drain(..) {
                let (level, operator) = (Level::Info, child.name.clone());
                self.log.write(&LogLine { time, level, operator, message: news.clone() });
                run.noted(&news);
            }
        }
        for reported in self.reported.drain(..) {
            let (level, operator) = (Level::Error, reported.operator.clone());
            self.log.write(&LogLine { time, level, operator, message: reported.reason.clone() });
            let fault = Fault { operator: reported.operator, reason: reported.reason, fatal: reported.fatal };
            run.failed(&fault);
            self.faults.push(fault);
        }
    }

    /// Takes all journal entries that wait.
    fn read_journals(&mut self) {
        self.read_answers();
        for (operator, journal) in self.journals.iter().enumerate() {
            while let Ok(Some(sample)) = journal.receive() {
                let Some(entry): Option<Entry> = entry_of(sample.pieces()) else { continue };
                self.incarnations[operator] = self.incarnations[operator].max(entry.header.incarnation);
                self.ledger.enter(operator, &entry);
                self.status.enter(operator, &entry);
                self.finished.enter(operator, &entry);
            }
        }
    }
}
