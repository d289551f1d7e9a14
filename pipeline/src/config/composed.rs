//! A pipeline that is to run, as one text that needs nothing else: what every process of the run reads, and what a session
//! keeps.

use std::collections::BTreeMap;

use super::check::{Purpose, Request, check};
use super::faults::Faults;
use super::machine::Machine;
use super::variables::Replaced;
use super::write;
use crate::graph::Graph;
use crate::operator::{Files, Registry};

/// A checked pipeline, and what the same graph is made from where the environment is another.
#[derive(Clone)]
pub struct Composed {
    /// The graph.
    pub graph: Graph,
    /// The text of the file, with the values of its variables in their places.
    pub text: String,
    /// The arguments of `--set`, likewise.
    pub sets: Vec<String>,
    /// The variables of the environment that paths named, with their values.
    pub variables: BTreeMap<String, String>,
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
    let (graph, replaced) = request.checked()?;
    if replaced.paths.is_empty() {
        let (text, sets) = (text.to_owned(), sets.to_vec());
        return Ok(Composed { graph, text, sets, variables: replaced.used });
    }
    let text = written(text, 0, &replaced);
    let sets: Vec<String> = sets.iter().enumerate().map(|(i, set)| written(set, i + 1, &replaced)).collect();
    // Every process of the run makes its graph from this text, and so does this one.
    let graph = check(&text, file_name, &sets, registry, files)?;
    Ok(Composed { graph, text, sets, variables: replaced.used })
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
