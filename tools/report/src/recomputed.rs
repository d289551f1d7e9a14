//! Computes images and detections that a session does not hold, by a replay of the operators behind them, up to the last
//! chosen image.

use std::collections::BTreeMap;

use stillpoint_pipeline::graph::Graph;
use stillpoint_pipeline::replay::{ReplayError, Selection, replay};
use stillpoint_pipeline::sample_store::OwnedSample;
use stillpoint_pipeline::schedule::{Observer, ObserverError};
use stillpoint_pipeline::stdout::StdoutRedirect;
use stillpoint_recorder::SessionError;
use stillpoint_samples::Entry;

use super::camera::{Camera, Found};
use super::source::Source;
use super::wiring::is_activation;

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
    ) -> Result<(), ObserverError> {
        let origin = entry.header.origin;
        if self.requested.contains(&origin) {
            for (port, owned) in outputs {
                if let Some(topic) = self.topics.get(&(operator, *port)) {
                    self.found.insert((topic.clone(), origin), (*owned.bytes).clone());
                }
            }
        }
        let is_past = operator == self.stage && self.requested.last().is_none_or(|last| origin >= *last);
        if is_past && is_activation(entry) {
            let name = &self.graph.operators[operator].name;
            return Err(ObserverError::Enough(format!("enough was made again of {name}")));
        }
        Ok(())
    }
}

/// Why images and detections are not computed.
#[derive(Debug, thiserror::Error)]
pub enum RecomputeError {
    /// The pipeline is not one of this build.
    #[error("the session does not hold the detections, and this build cannot run its pipeline: {0}")]
    Pipeline(String),
    /// The session was recorded in another layout.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The pipeline does not have the camera.
    #[error("the pipeline has no such operator")]
    Operator,
    /// The session cannot be replayed.
    #[error(transparent)]
    Replay(#[from] ReplayError),
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
) -> Result<(), RecomputeError> {
    let pipeline = source.pipeline.as_ref();
    let (graph, files) = pipeline.map_err(|reason| RecomputeError::Pipeline(reason.to_string()))?;
    let session = source.recording.session;
    session.check_layouts()?;
    let stage = graph.operator(&camera.stage).ok_or(RecomputeError::Operator)?;
    let topics = camera.results.values().chain([&camera.image]);
    let topics = topics.filter_map(|t| Some((graph.topic(t)?, t.clone()))).collect();
    let mut collector = Collector { graph, topics, stage, requested, found };
    let _aside = StdoutRedirect::to_stderr();
    match replay(session, graph, files, &Selection::Only(camera.stage.clone()), &mut collector) {
        Ok(_) | Err(ReplayError::Observer(ObserverError::Enough(_))) => Ok(()),
        Err(e) => Err(e.into()),
    }
}
