//! What the graph of a run was checked from.

use serde::{Deserialize, Serialize};

use crate::config::{self, Faults};
use crate::files::Snapshot;
use crate::graph::Graph;
use crate::operator::Registry;

/// What the graph of a run was checked from: every process of the run makes the same graph from it, and a session keeps
/// it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunSource {
    /// Text of the pipeline.
    pub text: String,
    /// Name of its file, for messages.
    pub file: String,
    /// `--set` overrides.
    pub sets: Vec<String>,
    /// The files that params name, as they were when the run began.
    pub files: Snapshot,
}

impl RunSource {
    /// The graph, checked again.
    pub fn check(&self, registry: &Registry) -> Result<Graph, Faults> {
        config::check(&self.text, &self.file, &self.sets, registry, &self.files)
    }
}
