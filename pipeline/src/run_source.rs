//! What the graph of a run was checked from.

use std::collections::BTreeMap;

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
    /// Variables of the environment that stood in paths, with the values that `text` and `sets` have in their places.
    #[serde(default)]
    pub variables: BTreeMap<String, String>,
    /// The files that the pipeline included, which `text` holds, with their SHA-256.
    #[serde(default)]
    pub included: BTreeMap<String, String>,
}

impl RunSource {
    /// The graph, checked again.
    pub fn check(&self, registry: &Registry) -> Result<Graph, Faults> {
        config::check(&self.text, &self.file, &self.sets, registry, &self.files)
    }
}
