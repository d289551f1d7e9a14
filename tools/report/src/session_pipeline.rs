//! The pipeline that a session keeps, checked against this build.

use std::collections::BTreeMap;

use serde_json::{Map, Value};
use stillpoint_operator::Registry;
use stillpoint_pipeline::config::{self, Faults};
use stillpoint_pipeline::former_defaults::former_defaults;
use stillpoint_pipeline::graph::Graph;
use stillpoint_pipeline::session::{INCLUDED, PARAMS, PIPELINE, SETS, VARIABLES};
use stillpoint_pipeline::session_files::SessionFiles;
use stillpoint_recorder::Session;

/// Metadata record of a session that was joined from those of several hosts: `HOST.session`, `HOST.offset_ns` and
/// `HOST.uncertainty_ns` of each, and the host whose `axis` of time it has.
pub const MERGED: &str = "stillpoint.merged";

/// Why the pipeline of a session cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SessionPipelineError {
    /// The session has no such attachment.
    #[error("the session has no {0}: it is not a session of stillpoint, or its start is lost")]
    Missing(&'static str),
    /// The session was joined from others.
    #[error(
        "the session was joined from those of the hosts {0}, so it has no pipeline and does not replay: give the session of \
         one host"
    )]
    Joined(String),
    /// An attachment cannot be read.
    #[error("{name} of the session: {reason}")]
    Unreadable {
        /// Name of the attachment.
        name: &'static str,
        reason: String,
    },
    /// The pipeline has faults for this build.
    #[error("the session's pipeline does not fit this build:\n{0}")]
    Faults(Faults),
}

/// A pipeline that a session keeps, as it was recorded or with changes.
pub struct SessionPipeline {
    /// The checked pipeline.
    pub graph: Graph,
    /// The files that the session keeps.
    pub files: SessionFiles,
    /// Text of the pipeline.
    pub text: String,
    /// Arguments of `--set`: those of the recording, those that keep the defaults of its time, those that are added.
    pub sets: Vec<String>,
    /// Variables of the environment that paths named when it was recorded, with their values.
    pub variables: BTreeMap<String, String>,
    /// Files that the pipeline included when it was recorded, with their SHA-256.
    pub included: BTreeMap<String, String>,
}

/// The checked pipeline of a session, and the files that the session keeps.
///
/// # Errors
/// The session keeps no pipeline, or one that this build refuses.
pub fn pipeline_of(
    session: &Session,
    registry: &Registry,
) -> Result<(Graph, SessionFiles), SessionPipelineError> {
    let SessionPipeline { graph, files, .. } = recorded_pipeline(session, registry)?;
    Ok((graph, files))
}

/// The same with what it was checked from.
///
/// # Errors
/// The session keeps no pipeline, or one that this build refuses.
pub fn recorded_pipeline(
    session: &Session,
    registry: &Registry,
) -> Result<SessionPipeline, SessionPipelineError> {
    if let Some(hosts) = session.metadata().get(MERGED) {
        let hosts: Vec<&str> = hosts.keys().filter_map(|key| key.strip_suffix(".session")).collect();
        return Err(SessionPipelineError::Joined(hosts.join(", ")));
    }
    let text = |name: &'static str| {
        let retained = session.attachments().get(name).ok_or(SessionPipelineError::Missing(name))?;
        String::from_utf8(retained.bytes.clone())
            .map_err(|e| SessionPipelineError::Unreadable { name, reason: e.to_string() })
    };
    let source = text(PIPELINE)?;
    let mut sets: Vec<String> = serde_json::from_str(&text(SETS)?)
        .map_err(|e| SessionPipelineError::Unreadable { name: SETS, reason: e.to_string() })?;
    let files = SessionFiles::of(session);
    let registry = registry.for_recorded();
    let check = |sets: &[String]| {
        config::check(&source, PIPELINE, sets, &registry, &files).map_err(SessionPipelineError::Faults)
    };
    let mut graph = check(&sets)?;
    let former = former_defaults(&graph, &recorded(session)?);
    if !former.is_empty() {
        sets.extend(former);
        graph = check(&sets)?;
    }
    let record = |name: &str| session.metadata().get(name).cloned().unwrap_or_default();
    let (variables, included) = (record(VARIABLES), record(INCLUDED));
    Ok(SessionPipeline { graph, files, text: source, sets, variables, included })
}

/// The resolved parameters that the session keeps, by operator. None are no reason to refuse a session.
fn recorded(session: &Session) -> Result<Map<String, Value>, SessionPipelineError> {
    let Some(retained) = session.attachments().get(PARAMS) else { return Ok(Map::new()) };
    serde_json::from_slice(&retained.bytes)
        .map_err(|e| SessionPipelineError::Unreadable { name: PARAMS, reason: e.to_string() })
}
