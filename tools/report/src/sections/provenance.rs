//! The provenance of a session: pipeline, parameters, seed, files, frames, build and processor.

use std::collections::BTreeMap;

use serde::Serialize;
use serde_json::Value;
use stillpoint_pipeline::session::{
    EXTRINSICS, FILES, HASHES, IDENTITY, INCLUDED, PARAMS, PIPELINE, RUN, SETS, VARIABLES,
};
use stillpoint_recorder::Session;

use crate::ReportError;
use crate::graph::{Drawing, svg_in_page};
use crate::numbers::{count, started};
use crate::page::{Block, Cell, Section, Table};
use crate::source::Source;
use crate::trace::{Journals, as_run};

/// A drawing of more operators would not be read.
const MOST_DRAWN: usize = 120;

#[derive(Serialize)]
struct ProvenanceFigures {
    run: BTreeMap<String, String>,
    identity: BTreeMap<String, String>,
    started_utc: Option<String>,
    sets: Value,
    variables: BTreeMap<String, String>,
    included: BTreeMap<String, String>,
    params: Value,
    files: Vec<File>,
    frames: BTreeMap<String, String>,
    pipeline: Option<String>,
    /// Why this build cannot run the pipeline, if so.
    pipeline_is_foreign: Option<String>,
}

#[derive(Serialize)]
struct File {
    name: String,
    bytes: usize,
    sha256: Option<String>,
}

pub fn section(from: &Source<'_>) -> Result<Section, ReportError> {
    let figures = figures(from);
    let mut section = Section::new("provenance", "Provenance", &figures)?;
    let mut say = |block| section.blocks.push(block);
    if let Some(reason) = &figures.pipeline_is_foreign {
        say(Block::Warning(format!("This build cannot run the session's pipeline: {reason}")));
    }
    let mut facts = Table::new("", &["fact", "value"]);
    let started = figures.started_utc.iter().map(|t| ("started".to_owned(), t.clone()));
    let own = figures.run.iter().chain(&figures.identity).filter(|(name, _)| *name != "cpu_features");
    for (name, value) in started.chain(own.map(|(n, v)| (words(n), v.clone()))) {
        facts.row([Cell::text(name), Cell::text(value)]);
    }
    say(Block::Table(facts));
    let count_of_operators = from.recording.wiring.stages().len();
    if (1..=MOST_DRAWN).contains(&count_of_operators) {
        let graph = from.pipeline.as_ref().ok().map(|(graph, _)| graph.as_ref());
        let ran = graph.map(|graph| as_run(graph, from.recording.session));
        let journals = Journals::of_session(from.recording.session, ran.as_ref());
        let caption = "Operators in their processes, with rate, median latency and losses at each input. A dashed edge \
                       closes a loop, a dotted one is a link.";
        say(Block::Drawing(svg_in_page(&Drawing::of(&journals, graph)), caption.into()));
    }
    if !figures.frames.is_empty() {
        let mut table = Table::new("Frames", &["frame", "where"]);
        figures.frames.iter().for_each(|(name, place)| table.row([Cell::text(name), Cell::text(place)]));
        say(Block::Table(table));
    }
    if !figures.variables.is_empty() {
        let mut table =
            Table::new("Variables of the environment in paths of the pipeline", &["variable", "value"]);
        figures.variables.iter().for_each(|(name, value)| table.row([Cell::text(name), Cell::text(value)]));
        say(Block::Table(table));
    }
    if !figures.included.is_empty() {
        let mut table =
            Table::new("Files that the pipeline included, joined in its text below", &["file", "SHA-256"]);
        figures.included.iter().for_each(|(name, hash)| table.row([Cell::text(name), Cell::text(hash)]));
        say(Block::Table(table));
    }
    if !figures.files.is_empty() {
        let mut table =
            Table::new("Files that parameters name, stored in the session", &["file", "bytes", "SHA-256"]);
        for f in &figures.files {
            let hash = f.sha256.as_deref().unwrap_or("");
            table.row([Cell::text(&f.name), Cell::number(count(f.bytes as u64)), Cell::text(hash)]);
        }
        say(Block::Table(table));
    }
    for (title, text) in [
        ("The pipeline as run", figures.pipeline.clone()),
        ("Parameters that --set overrode", listed(&figures.sets)),
        ("Every parameter, resolved", listed(&figures.params)),
        ("Features of the processor", figures.identity.get("cpu_features").cloned()),
    ] {
        if let Some(text) = text {
            say(Block::Listing { title: title.to_owned(), text });
        }
    }
    Ok(section)
}

fn figures(from: &Source<'_>) -> ProvenanceFigures {
    let session = from.recording.session;
    let record = |name: &str| session.metadata().get(name).cloned().unwrap_or_default();
    let json =
        |name: &str| text(session, name).and_then(|t| serde_json::from_str(&t).ok()).unwrap_or(Value::Null);
    let hashes = record(HASHES);
    let files = session.attachments().values().filter_map(|a| {
        let name = a.name.strip_prefix(FILES)?;
        Some(File { name: name.to_owned(), bytes: a.bytes.len(), sha256: hashes.get(name).cloned() })
    });
    ProvenanceFigures {
        run: record(RUN),
        identity: record(IDENTITY),
        started_utc: started(session),
        sets: json(SETS),
        variables: record(VARIABLES),
        included: record(INCLUDED),
        params: json(PARAMS),
        files: files.collect(),
        frames: record(EXTRINSICS),
        pipeline: text(session, PIPELINE),
        pipeline_is_foreign: from.pipeline.as_ref().err().map(ToString::to_string),
    }
}

fn text(session: &Session, name: &str) -> Option<String> {
    session.attachments().get(name).map(|a| String::from_utf8_lossy(&a.bytes).into_owned())
}

/// The items, one per line; `None` if there are none.
fn listed(value: &Value) -> Option<String> {
    match value {
        Value::Null => None,
        Value::Array(items) if items.is_empty() => None,
        Value::Array(items) => {
            let lines = items.iter().map(|i| i.as_str().map_or_else(|| i.to_string(), str::to_owned));
            Some(lines.collect::<Vec<_>>().join("\n"))
        }
        Value::Object(operators) => {
            let mut lines = Vec::new();
            for (operator, params) in operators {
                flatten(operator, params, &mut lines);
            }
            Some(lines.join("\n"))
        }
        other => Some(other.to_string()),
    }
}

/// Params as `operator.param: value`, one a line.
fn flatten(name: &str, value: &Value, lines: &mut Vec<String>) {
    match value {
        Value::Object(inner) => {
            inner.iter().for_each(|(key, value)| flatten(&format!("{name}.{key}"), value, lines));
        }
        value => lines.push(format!("{name}: {value}")),
    }
}

fn words(name: &str) -> String {
    match name {
        "directed" => "simulated".to_owned(),
        "build" => "SHA-256 of the program".to_owned(),
        other => other.replace('_', " "),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn params_stand_one_a_line_with_their_operator() {
        let params = json!({ "face": { "leaf": "5 mm", "inner": { "a": 1 } }, "sink": {} });
        assert_eq!(listed(&params).unwrap(), "face.leaf: \"5 mm\"\nface.inner.a: 1");
        assert_eq!((listed(&json!([])), listed(&Value::Null)), (None, None));
        assert_eq!(listed(&json!(["a.b=1", "c.d=2"])).unwrap(), "a.b=1\nc.d=2");
    }
}
