//! A whole pipeline in the simulated executor.

use std::sync::Arc;

use stillpoint_operator::Files;
use stillpoint_operator::Registry;
use stillpoint_pipeline::config::check;
use stillpoint_pipeline::graph::Graph;
use stillpoint_pipeline::placement::Local;
use stillpoint_pipeline::sample_store::OwnedSample;
use stillpoint_pipeline::schedule::{Events, Observer, ObserverError};
use stillpoint_samples::{Entry, Outcome, Sample, View};

/// When runs start, ns since the epoch.
pub const START: u64 = 1_800_000_000_000_000_000;

/// All that a pipeline sent.
pub struct Run {
    pub graph: Arc<Graph>,
    keep: fn(&str) -> bool,
    sent: Vec<(String, OwnedSample)>,
    failed: Vec<String>,
}

/// Checks a pipeline's text and runs it for `ms` milliseconds of session time.
///
/// # Errors
/// The faults of the text, or why the run ended early.
pub fn run(text: &str, registry: &Registry, files: &dyn Files, ms: u64) -> Result<Run, String> {
    run_keeping(|_| true, text, registry, files, ms)
}

/// The same, of which only these topics are kept: a minute of images is some gigabytes.
///
/// # Errors
/// The faults of the text, or why the run ended early.
pub fn run_keeping(
    keep: fn(&str) -> bool,
    text: &str,
    registry: &Registry,
    files: &dyn Files,
    ms: u64,
) -> Result<Run, String> {
    let graph = check(text, "test.yaml", &[], registry, files).map_err(|faults| faults.to_string())?;
    let graph = Arc::new(graph);
    let mut run = Run { graph: graph.clone(), keep, sent: Vec::new(), failed: Vec::new() };
    let mut placement = Local::new(graph.clone(), files);
    Events::new(graph).run(&mut placement, START, ms * 1_000_000, &mut run).map_err(|e| e.to_string())?;
    Ok(run)
}

impl Observer for Run {
    fn on_activation(
        &mut self,
        operator: usize,
        entry: &Entry,
        outputs: &[(usize, OwnedSample)],
    ) -> Result<(), ObserverError> {
        let node = &self.graph.operators[operator];
        if entry.outcome().is_none_or(Outcome::is_failure) {
            self.failed.push(node.name.clone());
        }
        let sent = outputs.iter().map(|(port, p)| (&node.outputs[*port].topic, p));
        let retained = sent.filter(|(topic, _)| (self.keep)(topic));
        self.sent.extend(retained.map(|(topic, p)| (topic.clone(), p.clone())));
        Ok(())
    }
}

impl Run {
    /// The samples of a topic, in the order of sending. A topic of another type has none.
    pub fn samples<S: Sample>(&self, topic: &str) -> Vec<View<'_, S>> {
        self.owned_samples(topic).filter_map(|p| p.pieces().view::<S>().ok()).collect()
    }

    /// The bytes of a topic's samples, heads included, one behind the other.
    pub fn bytes(&self, topic: &str) -> Vec<u8> {
        self.owned_samples(topic).flat_map(|p| p.bytes.iter().copied()).collect()
    }

    /// The topics that have samples, sorted.
    pub fn topics(&self) -> Vec<&str> {
        let topics: std::collections::BTreeSet<&str> = self.sent.iter().map(|(t, _)| t.as_str()).collect();
        topics.into_iter().collect()
    }

    /// Names of operators, one for each activation that failed.
    pub fn failed(&self) -> &[String] {
        &self.failed
    }

    /// The samples of a topic as bytes, in the order of sending.
    pub fn owned_samples(&self, topic: &str) -> impl Iterator<Item = &OwnedSample> {
        self.sent.iter().filter(move |(t, _)| t == topic).map(|(_, p)| p)
    }
}
