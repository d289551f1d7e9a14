//! Computes images and detections that a session does not hold, by a replay of the operators behind them, up to the last
//! chosen image.

use std::collections::BTreeMap;

use stillpoint_pipeline::graph::Graph;
use stillpoint_pipeline::replay::{ReplayError, Selection, replay};
use stillpoint_pipeline::sample_store::OwnedSample;
use stillpoint_pipeline::schedule::Observer;
use stillpoint_pipeline::stdout::StdoutRedirect;
use stillpoint_samples::Entry;

use super::camera::{Camera, Found};
use super::source::Source;
use super::wiring::is_activation;

/// The reason with which the observer ends the replay.
const ENOUGH: &str = "enough was made again";

/// Keeps the wanted samples of a replay, and ends it after the last one.
struct Collector<'a> {
    graph: &'a Graph,
    /// Operator and output of each topic that is wanted.
    topics: BTreeMap<(usize, usize), String>,
    stage: usize,
    requested: &'a [u64],
    found: &'a mut Found,
}

impl Observer for Collector<'_> {
    fn on_activation(
        &mut self,
        operator: usize,
        entry: &Entry,
        outputs: &[(usize, OwnedSample)],
    ) -> Result<(), String> {
        let origin = entry.header.origin;
        if self.requested.contains(&origin) {
            for (port, owned) in outputs {
                if let Some(topic) = self.topics.get(&(operator, *port)) {
                    self.found.insert((topic.clone(), origin), (*owned.bytes).clone());
                }
            }
        }
        let is_past = operator == self.stage && self.requested.last().is_none_or(|last| origin >= *last);
        let sentence = || format!("{ENOUGH} of {}", self.graph.operators[operator].name);
        if is_past && is_activation(entry) { Err(sentence()) } else { Ok(()) }
    }
}

/// Adds what is wanted of a camera: images and results of these origins.
///
/// # Errors
/// The pipeline is not one of this build, or cannot be replayed.
pub fn recomputed_views(
    source: &Source<'_>,
    camera: &Camera,
    requested: &[u64],
    found: &mut Found,
) -> Result<(), String> {
    let (graph, files) = source.pipeline.as_ref().map_err(|reason| {
        format!("the session does not hold the detections, and this build cannot run its pipeline: {reason}")
    })?;
    let session = source.recording.session;
    session.check_layouts().map_err(|e| e.to_string())?;
    let stage = graph.operator(&camera.stage).ok_or("the pipeline has no such operator")?;
    let topics = camera.results.values().chain([&camera.image]);
    let topics = topics.filter_map(|t| Some((graph.topic(t)?, t.clone()))).collect();
    let mut collector = Collector { graph, topics, stage, requested, found };
    let _aside = StdoutRedirect::to_stderr();
    match replay(session, graph, files, &Selection::Only(camera.stage.clone()), &mut collector) {
        Err(ReplayError::Observer(sentence)) if sentence.starts_with(ENOUGH) => Ok(()),
        Ok(_) => Ok(()),
        Err(e) => Err(e.to_string()),
    }
}
