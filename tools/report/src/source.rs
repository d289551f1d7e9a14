//! What sections are made of.

use std::sync::Arc;

use nalgebra::{Quaternion, UnitQuaternion};
use stillpoint_operator::frames::{Frame, Frames, Rigid};
use stillpoint_pipeline::graph::Graph;
use stillpoint_pipeline::session_files::SessionFiles;

use super::recording::Recording;
use super::session_pipeline::SessionPipelineError;

/// A session as it was read, and its pipeline as far as this build knows it.
pub struct Source<'s> {
    pub recording: Recording<'s>,
    /// The checked pipeline with the files that it names, or why there is none.
    pub pipeline: Result<(Arc<Graph>, SessionFiles), SessionPipelineError>,
    /// Pictures of each camera at most.
    pub pictures: usize,
}

impl Source<'_> {
    /// The frame of a topic, recorded or not.
    fn frame(&self, topic: &str) -> Option<String> {
        let recorded = self.recording.session.topics().iter().find(|t| t.name == topic);
        recorded.map(|t| t.frame.clone()).unwrap_or_else(|| {
            let (graph, _) = self.pipeline.as_ref().ok()?;
            let (operator, output) = graph.topic(topic)?;
            graph.operators[operator].outputs[output].frame.clone()
        })
    }

    /// The transform from the frame of one topic to that of another, as the session states frames; `None` where they are
    /// in one frame, or nothing is known.
    pub fn transform(&self, to: &str, from: &str) -> Option<Rigid> {
        let (to, from) = (self.frame(to)?, self.frame(from)?);
        if to == from {
            return None;
        }
        let mut frames = Frames::default();
        for t in self.recording.session.frames() {
            let [w, i, j, k] = t.rotation;
            let turn = UnitQuaternion::from_quaternion(Quaternion::new(w, i, j, k)).to_rotation_matrix();
            let rotation = std::array::from_fn(|row| std::array::from_fn(|column| turn[(row, column)]));
            let parent_from_frame = Rigid { translation: t.translation, rotation };
            let frame = Frame { parent: t.parent.clone(), parent_from_frame, measured: None, residual: None };
            frames.placed.insert(t.child.clone(), frame);
        }
        frames.transform(&to, &from)
    }
}
