//! One window of a bench: a pipeline that runs live for a while, with a tap on what its sinks say.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use stillpoint_operator::Registry;
use stillpoint_pipeline::live::status::OperatorFigures;
use stillpoint_pipeline::live::{Fault, Run, RunOptions, RunReport, Supervisor, contracts};
use stillpoint_pipeline::session::identity;
use stillpoint_pipeline::spec;
use stillpoint_recorder::Compression;

use super::figures::Ages;
use super::stages::Load;
use stillpoint::Failure;
use stillpoint::Which;

/// How often a tap looks, as `echo` does.
const LOOK_EVERY: Duration = Duration::from_millis(10);

/// What is run.
pub struct Window<'a> {
    /// The pipeline's text.
    pub pipeline: &'a str,
    /// Kinds of operators.
    pub registry: &'a Registry,
    /// How long.
    pub length: Duration,
    /// Where it is recorded, and how it is compressed there.
    pub session: Option<(&'a Path, Compression)>,
    /// Topics that are looked at as `echo` looks at them. What sinks say among them is kept.
    pub taps: &'a [&'a str],
}

/// What came of it.
pub struct Outcome {
    /// By tapped topic: ages that its sink told of.
    pub ages: BTreeMap<String, Ages>,
    /// How the run went.
    pub report: RunReport,
}

impl Outcome {
    /// The ages that one sink told of.
    pub fn ages_of(&mut self, topic: &str) -> Ages {
        self.ages.remove(topic).unwrap_or_default()
    }
}

impl Window<'_> {
    /// Runs it.
    pub fn run(&self) -> Result<Outcome, Failure> {
        self.run_watched(&AtomicBool::new(false), &mut Nobody)
    }

    /// Runs it under the eyes of `run`, until `stop` is set or its time is over.
    pub fn run_watched(&self, stop: &AtomicBool, run: &mut dyn Run) -> Result<Outcome, Failure> {
        let file = "bench.yaml".to_string();
        let files = stillpoint_operator::files::DiskFiles::beside(Path::new(&file));
        let graph = spec::check(self.pipeline, &file, &[], self.registry, &files).map_err(Failure::failed)?;
        if let Some((session, _)) = self.session {
            stillpoint_recorder::create_session(session)
                .map_err(|e| Failure::failed(format!("{}: {e}", session.display())))?;
        }
        let options = RunOptions {
            source: self.pipeline.to_string(),
            file,
            sets: Vec::new(),
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

    /// Looks at topics until the run is over.
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
                        let told: &mut Ages = ages.entry((*name).to_string()).or_default();
                        told.take(view.elements.iter().map(|w| w.word));
                    }
                }
            }
            std::thread::sleep(LOOK_EVERY);
        }
        Ok(ages)
    }
}

/// Does not care how a run goes on.
pub struct Nobody;

impl Run for Nobody {
    fn goes_on(&mut self, _: f64, _: &[OperatorFigures]) {}
    fn failed(&mut self, fault: &Fault) {
        errln!("stillpoint: {}: {}", fault.operator, fault.reason);
    }
    fn started(&mut self, _: &[(String, u32)]) {}
}
