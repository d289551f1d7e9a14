//! A pipeline that is to run, as one text that needs nothing else: what every process of the run reads, and what a session
//! keeps.

use std::collections::BTreeMap;

use sha2::{Digest, Sha256};

use super::check::{BEGINNING, Expansion, Purpose, Request, check};
use super::faults::{Code, Faults, Findings};
use super::includes::FileText;
use super::machine::Machine;
use super::source::{MOST_BYTES, Sources, Span};
use super::tree::{Node, Value};
use super::variables::Replaced;
use super::write;
use crate::graph::Graph;
use crate::operator::{Files, Registry};
use crate::session::hex;

/// A checked pipeline, and what the same graph is made from where the environment is another.
#[derive(Clone)]
pub struct Composed {
    /// The graph.
    pub graph: Graph,
    /// The text of the file, with what it includes and the values of its variables in their places.
    pub text: String,
    /// The arguments of `--set`, likewise.
    pub sets: Vec<String>,
    /// The variables of the environment that paths named, with their values.
    pub variables: BTreeMap<String, String>,
    /// The files that it includes, by their paths from its folder, with their SHA-256.
    pub included: BTreeMap<String, String>,
}

/// As [`check_for`](super::check_for), with what the same graph is made from anywhere.
pub fn compose_for(
    machine: &Machine,
    text: &str,
    file_name: &str,
    sets: &[String],
    registry: &Registry,
    files: &dyn Files,
) -> Result<Composed, Faults> {
    let purpose = Purpose::Run;
    composed(&Request { machine, purpose, text, file_name, sets, registry, files })
}

/// The same for a pipeline that is to run on the samples of a session: its operators are not made, and no machine is asked
/// but for the variables of this process.
pub fn compose_to_rerun(
    text: &str,
    file_name: &str,
    sets: &[String],
    registry: &Registry,
    files: &dyn Files,
) -> Result<Composed, Faults> {
    let (machine, purpose) = (&Machine::any(), Purpose::Rerun);
    composed(&Request { machine, purpose, text, file_name, sets, registry, files })
}

fn composed(request: &Request<'_>) -> Result<Composed, Faults> {
    let Request { text, file_name, sets, registry, files, .. } = *request;
    let (graph, Expansion { texts, tree, replaced, .. }) = request.checked()?;
    let hash = |file: &FileText| (file.path.clone(), hex(&Sha256::digest(&file.source.text)));
    let included = texts[1..].iter().map(hash).collect();
    let variables = replaced.used.clone();
    if replaced.paths.is_empty() && tree.is_none() {
        let (text, sets) = (text.to_owned(), sets.to_vec());
        return Ok(Composed { graph, text, sets, variables, included });
    }
    let whole = match tree {
        Some(tree) => joined(tree, &texts, &replaced)?,
        None => written(text, 0, &replaced),
    };
    let argument = |(i, set): (usize, &String)| written(set, texts.len() + i, &replaced);
    let sets: Vec<String> = sets.iter().enumerate().map(argument).collect();
    // Every process of the run makes its graph from this text, and so does this one.
    let graph = check(&whole, file_name, &sets, registry, files)?;
    Ok(Composed { graph, text: whole, sets, variables, included })
}

/// The text of a pipeline that includes others. Comments name the files that parts came from, by their paths from the folder
/// of the pipeline file, so that all hosts of a pipeline have the same text.
fn joined(mut tree: Node, texts: &[FileText], replaced: &Replaced) -> Result<String, Faults> {
    replace(&mut tree, &replaced.paths);
    let note = |node: &Node, parent: &Node| {
        let from = &texts.get(node.span.source)?.path;
        (node.span.source != parent.span.source).then(|| format!("{from}:{}", node.span.line))
    };
    let names: Vec<&str> = texts.iter().map(|file| file.path.as_str()).collect();
    let names = names.join(", ").replace(['\n', '\r'], " ");
    let text = format!("# Joined from {names}.\n{}", write::tree(&tree, &note));
    if text.len() <= MOST_BYTES {
        return Ok(text);
    }
    let findings = Findings::default();
    findings.say(
        BEGINNING,
        Code::TooLarge,
        format!("with what it includes, the pipeline has more than the {MOST_BYTES} bytes that one may have"),
        "split it into several pipelines",
    );
    Err(findings.into_faults(Sources::of_files(texts.iter().map(|file| file.source.clone()).collect(), &[])))
}

/// Puts paths into a tree in the place of what named variables.
fn replace(node: &mut Node, paths: &BTreeMap<Span, String>) {
    match &mut node.value {
        Value::Text(text) => {
            if let Some(path) = paths.get(&node.span) {
                *text = path.clone();
            }
        }
        Value::List(items) => items.iter_mut().for_each(|item| replace(item, paths)),
        Value::Map(entries) => entries.iter_mut().for_each(|entry| replace(&mut entry.value, paths)),
        _ => {}
    }
}

/// A text with the paths that replace what names variables.
fn written(text: &str, source: usize, replaced: &Replaced) -> String {
    let mut text = text.to_owned();
    for (span, path) in replaced.paths.iter().rev().filter(|(span, _)| span.source == source) {
        // The place of a text between brackets ends at what follows it.
        let end = span.start + text[span.start..span.end].trim_end().len();
        text.replace_range(span.start..end, &write::scalar(path));
    }
    text
}
