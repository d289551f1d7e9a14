//! The topics, attachments and metadata that a session keeps of its run.

use std::collections::{BTreeMap, BTreeSet};

use sha2::{Digest, Sha256};
use stillpoint_recorder::{Attachment, ClockSample, Opening, Role as TopicRole, StaticTransform, TopicInfo};
use stillpoint_samples::{Diagnostics, Journal, Sample};

use crate::clock::{SessionClock, realtime};
use crate::files::FileError;
use crate::graph::{Graph, journal_topic, timing_topic};
use crate::operator::Files;
use crate::operator::Role;
use crate::program::Program;
use crate::run_source::RunSource;

/// Name of the attachment that is the pipeline's text.
pub const PIPELINE: &str = "pipeline.yaml";
/// Name of the attachment with the `--set` overrides, a JSON list.
pub const SETS: &str = "sets.json";
/// Name of the attachment with the resolved params, JSON by operator.
pub const PARAMS: &str = "params.json";
/// Folder of the files that params name, among the attachments.
pub const FILES: &str = "files/";
/// Metadata record with the SHA-256 of each file that params name.
pub const HASHES: &str = "stillpoint.files";
/// Metadata record with name of the pipeline, seed and file name.
pub const RUN: &str = "stillpoint.run";
/// Metadata record with build and CPU.
pub const IDENTITY: &str = "stillpoint.identity";

/// Metadata record with date and residual of each frame.
pub const EXTRINSICS: &str = "stillpoint.extrinsics";
/// Metadata record of the variables of the environment that paths of the pipeline named, with their values.
pub const VARIABLES: &str = "stillpoint.variables";
/// Metadata record with the SHA-256 of each file that the pipeline included, and that its text holds.
pub const INCLUDED: &str = "stillpoint.included";
/// Record of what operators leave out of their files, by operator.
pub const REMARKS: &str = "stillpoint.remarks";

/// The topics that a session of this graph keeps. Each with its operator, and its output where it is no journal.
pub fn topic_infos(graph: &Graph) -> Vec<(TopicInfo, (usize, Option<usize>))> {
    let mut infos = Vec::new();
    for (operator, node) in graph.operators.iter().enumerate() {
        let topic_of = |edge: &Option<crate::graph::Edge>| {
            edge.map(|e| graph.operators[e.operator].outputs[e.output].topic.clone()).unwrap_or_default()
        };
        let role = TopicRole::Journal {
            inputs: node.inputs.iter().map(|i| topic_of(&i.edge)).collect(),
            outputs: node.outputs.iter().map(|o| o.topic.clone()).collect(),
        };
        let info = TopicInfo {
            name: journal_topic(&node.name),
            operator: node.name.clone(),
            kind: Journal::KIND,
            frame: None,
            role,
        };
        infos.push((info, (operator, None)));
        for (port, output) in node.outputs.iter().enumerate() {
            if !graph.is_recorded(operator, port) {
                continue;
            }
            let role = match node.stage.kind.role {
                Role::Source => TopicRole::Source,
                Role::Operator => TopicRole::Computed,
            };
            let info = TopicInfo {
                name: output.topic.clone(),
                operator: node.name.clone(),
                kind: node.stage.kind.outputs[port].sample,
                frame: output.frame.clone(),
                role,
            };
            infos.push((info, (operator, Some(port))));
        }
    }
    infos
}

/// The topics of laps, which a live session keeps besides. Each with its operator.
pub fn timing_infos(graph: &Graph) -> Vec<(TopicInfo, usize)> {
    let measured = graph.operators.iter().enumerate().filter(|(_, node)| !node.stage.laps.is_empty());
    let info = |name: &str| TopicInfo {
        name: timing_topic(name),
        operator: name.to_string(),
        kind: Diagnostics::KIND,
        frame: None,
        role: TopicRole::Measured,
    };
    measured.map(|(operator, node)| (info(&node.name), operator)).collect()
}

/// Why the start of a session cannot be put together.
#[derive(Debug, thiserror::Error)]
pub enum OpeningError {
    /// A file that params name.
    #[error(transparent)]
    File(#[from] FileError),
    /// The params cannot be written as JSON.
    #[error("{0}")]
    Params(#[from] serde_json::Error),
}

/// The start of a part.
///
/// Params name files that `source` holds; a run whose activations are `directed` by a schedule starts at session time 0.
pub fn opening(
    graph: &Graph,
    source: &RunSource,
    clock: SessionClock,
    directed: bool,
    identity: &BTreeMap<String, String>,
) -> Result<Opening, OpeningError> {
    let json = |value: &serde_json::Value| serde_json::to_vec_pretty(value);
    let keep = |name: &str, media: &str, bytes: Vec<u8>| Attachment {
        name: name.to_string(),
        media_type: media.to_string(),
        bytes,
    };
    let params: serde_json::Map<String, serde_json::Value> =
        graph.operators.iter().map(|o| (o.name.clone(), o.params.resolved.clone())).collect();
    let mut attachments = vec![
        keep(PIPELINE, "application/yaml", source.text.clone().into_bytes()),
        keep(SETS, "application/json", json(&serde_json::json!(source.sets))?),
        keep(PARAMS, "application/json", json(&serde_json::Value::Object(params))?),
    ];
    let files = &source.files;
    let mut hashes = BTreeMap::new();
    let mut names = BTreeSet::new();
    for name in graph.files() {
        names.extend(files.list(name).map_err(|e| FileError::new(name, &e))?);
    }
    for file in names {
        let bytes = files.read(&file).map_err(|e| FileError::new(&file, &e))?;
        hashes.insert(file.clone(), hex(&Sha256::digest(&bytes)));
        attachments.push(keep(&format!("{FILES}{file}"), "application/octet-stream", bytes));
    }
    let run = BTreeMap::from([
        ("pipeline".to_string(), graph.name.clone()),
        ("file".to_string(), source.file.clone()),
        ("seed".to_string(), graph.seed.to_string()),
        ("directed".to_string(), directed.to_string()),
    ]);
    let remarks = source.files.remarks().iter().map(|(name, all)| (name.clone(), all.join("\n")));
    let mut metadata = BTreeMap::from([
        (RUN.to_string(), run),
        (IDENTITY.to_string(), identity.clone()),
        (HASHES.to_string(), hashes),
        (EXTRINSICS.to_string(), extrinsics(graph)),
    ]);
    // A session of whole files is written as before.
    let remarks: BTreeMap<String, String> = remarks.collect();
    if !remarks.is_empty() {
        metadata.insert(REMARKS.to_string(), remarks);
    }
    for (record, entries) in [(VARIABLES, &source.variables), (INCLUDED, &source.included)] {
        if !entries.is_empty() {
            metadata.insert(record.to_string(), entries.clone());
        }
    }
    let frames = static_transforms(graph);
    // A simulated session knows no realtime: two equal runs give equal files.
    let started = clock.started();
    let clock =
        Some(ClockSample { logical_ns: started, realtime_ns: if started == 0 { 0 } else { realtime() } });
    Ok(Opening { attachments, metadata, frames, clock })
}

/// The frames that are placed in another.
pub fn static_transforms(graph: &Graph) -> Vec<StaticTransform> {
    let transform = |(name, frame): (&String, &crate::frames::Frame)| StaticTransform {
        parent: frame.parent.clone(),
        child: name.clone(),
        translation: frame.parent_from_frame.translation,
        rotation: frame.parent_from_frame.quaternion(),
    };
    graph.frames.placed.iter().map(transform).collect()
}

/// When and how well each frame was measured, as far as the pipeline says.
fn extrinsics(graph: &Graph) -> BTreeMap<String, String> {
    let say = |frame: &crate::frames::Frame| {
        let measured = frame.measured.as_deref().unwrap_or("unknown");
        let residual = frame.residual.map_or("unknown".to_string(), |r| format!("{r} m"));
        format!("in {}, measured {measured}, residual {residual}", frame.parent)
    };
    graph.frames.placed.iter().map(|(name, frame)| (name.clone(), say(frame))).collect()
}

/// Lower-case hexadecimal.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

/// Build and CPU of this process: replay is exact on the same of both.
pub fn identity() -> BTreeMap<String, String> {
    let mut facts = BTreeMap::from([
        ("stillpoint".to_string(), env!("CARGO_PKG_VERSION").to_string()),
        ("profile".to_string(), if cfg!(debug_assertions) { "debug" } else { "release" }.to_string()),
        ("architecture".to_string(), std::env::consts::ARCH.to_string()),
    ]);
    if let Ok(bytes) = Program::here().and_then(|program| std::fs::read(program.code)) {
        facts.insert("build".to_string(), hex(&Sha256::digest(&bytes)));
    }
    if let Ok(text) = std::fs::read_to_string("/proc/cpuinfo") {
        for (key, name) in [("model name", "cpu"), ("flags", "cpu_features"), ("Features", "cpu_features")] {
            if let Some(value) = text.lines().find_map(|l| l.strip_prefix(key)?.split_once(':')) {
                facts.insert(name.to_string(), value.1.trim().to_string());
            }
        }
    }
    facts
}
