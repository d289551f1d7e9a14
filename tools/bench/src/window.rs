//! One window of a measurement: a pipeline that runs live for a given time, with taps on the ages that its sinks send.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use stillpoint_operator::Registry;
use stillpoint_pipeline::config;
use stillpoint_pipeline::live::status::OperatorFigures;
use stillpoint_pipeline::live::{Fault, Run, RunOptions, RunReport, Supervisor, contracts};
use stillpoint_pipeline::session::identity;
use stillpoint_recorder::Compression;

use super::figures::Ages;
use super::stages::Load;
use stillpoint::Failure;
use stillpoint::Which;

/// Interval at which a tap reads its topics: that of `stillpoint echo`.
const LOOK_EVERY: Duration = Duration::from_millis(10);

/// A pipeline and the conditions of its run.
pub struct Window<'a> {
    /// The pipeline's text.
    pub pipeline: &'a str,
    pub registry: &'a Registry,
    /// Maximum length of the run.
    pub length: Duration,
    /// Folder and compression of the session; `None` for a run without a recording.
    pub session: Option<(&'a Path, Compression)>,
    /// Tapped topics, which are read as `stillpoint echo` reads them. The ages that sinks send are kept.
    pub taps: &'a [&'a str],
}

/// Result of a window.
pub struct Outcome {
    /// Ages that the sinks sent, by tapped topic.
    pub ages: BTreeMap<String, Ages>,
    /// Report of the run.
    pub report: RunReport,
}

impl Outcome {
    /// Takes the ages of a tapped topic out of the result; empty if there are none.
    pub fn ages_of(&mut self, topic: &str) -> Ages {
        self.ages.remove(topic).unwrap_or_default()
    }
}

impl Window<'_> {
    /// Runs the pipeline for its length.
    pub fn run(&self) -> Result<Outcome, Failure> {
        self.run_watched(&AtomicBool::new(false), &mut Nobody)
    }

    /// Runs the pipeline until `stop` is set or its length is over, and notifies `run` of the progress.
    pub fn run_watched(&self, stop: &AtomicBool, run: &mut dyn Run) -> Result<Outcome, Failure> {
        let file = "bench.yaml".to_string();
        let files = stillpoint_operator::files::DiskFiles::next_to(Path::new(&file));
        let graph =
            config::check(self.pipeline, &file, &[], self.registry, &files).map_err(Failure::failed)?;
        if let Some((session, _)) = self.session {
            stillpoint_recorder::create_session(session)
                .map_err(|e| Failure::failed(format!("{}: {e}", session.display())))?;
        }
        let options = RunOptions {
            source: self.pipeline.to_string(),
            file,
            sets: Vec::new(),
            variables: Default::default(),
            included: Default::default(),
            files,
            duration: Some(self.length.as_nanos() as u64),
            session: self.session.map(|(path, _)| PathBuf::from(path)),
            compression: self.session.map_or(Compression::None, |(_, compression)| compression),
            launch: stillpoint::launch()?,
            identity: identity(),
        };
        let supervisor = Supervisor::start(Arc::new(graph), options, stop, run).map_err(Failure::failed)?;
        let over = AtomicBool::new(false);
        std::thread::scope(|scope| {
            let tap = scope.spawn(|| self.tap(&over));
            let report = supervisor.watch(stop, run);
            over.store(true, Ordering::Relaxed);
            let ages = tap.join().unwrap_or_else(|_| Err(Failure::failed("a tap panicked")))?;
            Ok(Outcome { ages, report })
        })
    }

    /// Reads the tapped topics until the run is over.
    fn tap(&self, over: &AtomicBool) -> Result<BTreeMap<String, Ages>, Failure> {
        let mut ages = BTreeMap::new();
        if self.taps.is_empty() {
            return Ok(ages);
        }
        let run = Which { run: Some(std::process::id().to_string()) };
        let attached = run.attach(self.registry)?;
        let mut open = Vec::new();
        for name in self.taps {
            let (operator, port) =
                attached.graph.topic(name).ok_or_else(|| Failure::failed(format!("no topic {name}")))?;
            let contract = contracts::output(&attached.graph, operator, port);
            let topic = stillpoint_shm::Topic::open(&attached.domain, &contract).map_err(Failure::failed)?;
            let subscriber = topic.subscriber(contracts::TAP_DEPTH).map_err(Failure::failed)?;
            subscriber.connect().map_err(Failure::failed)?;
            let says = attached.graph.operators[operator].stage.kind.name == "bench.sink";
            open.push((*name, says, subscriber, topic));
        }
        while !over.load(Ordering::Relaxed) {
            for (name, says, subscriber, _) in &open {
                while let Some(sample) = subscriber.receive().map_err(Failure::failed)? {
                    if *says && let Ok(view) = sample.pieces().view::<Load>() {
                        let reported: &mut Ages = ages.entry((*name).to_string()).or_default();
                        reported.take(view.elements.iter().map(|w| w.word));
                    }
                }
            }
            std::thread::sleep(LOOK_EVERY);
        }
        Ok(ages)
    }
}

/// Prints the faults of a run and ignores its progress.
pub struct Nobody;

impl Run for Nobody {
    fn goes_on(&mut self, _: f64, _: &[OperatorFigures]) {}
    fn failed(&mut self, fault: &Fault) {
        errln!("stillpoint: {}: {}", fault.operator, fault.reason);
    }
    fn started(&mut self, _: &[(String, u32)]) {}
}
