//! What the start of an operator refuses: the content of its files, and parameters that do not go together.
//!
//! Each operator is made once as its process makes it, and let go. So the check refuses whatever a start can refuse, with
//! its place, and a new kind of operator needs nothing for that.

use super::faults::{Code, Findings};
use super::operators::ParsedOperator;
use super::source::Span;
use super::tree::{Node, Value};
use crate::graph::{Graph, OperatorNode};
use crate::instance::build_step;
use crate::operator::Files;
use crate::outside::{Arrivals, Outside};
use crate::stdout::StdoutRedirect;

/// Where the values of an operator are in the text.
pub struct Places {
    operator: String,
    name: Span,
    /// The scalars among its parameters.
    values: Vec<(String, Span)>,
}

/// The places of each operator.
pub fn places(operators: &[ParsedOperator<'_>]) -> Vec<Places> {
    let places = |parsed: &ParsedOperator<'_>| {
        let mut values = Vec::new();
        if let Some(params) = parsed.params {
            scalars(params, &mut values);
        }
        Places { operator: parsed.name.value.clone(), name: parsed.name.span, values }
    };
    operators.iter().map(places).collect()
}

fn scalars(node: &Node, found: &mut Vec<(String, Span)>) {
    match &node.value {
        Value::List(items) => items.iter().for_each(|item| scalars(item, found)),
        Value::Map(entries) => entries.iter().for_each(|entry| scalars(&entry.value, found)),
        Value::Text(text) => found.push((text.clone(), node.span)),
        _ => {}
    }
}

/// Makes each operator of a graph, and finds those that cannot start.
pub fn check(graph: &Graph, places: &[Places], files: &dyn Files, findings: &Findings) {
    // What an operator prints when it is made does not belong to the output of the command.
    let _aside = StdoutRedirect::to_stderr();
    one_listener_each(graph, places, findings);
    for node in &graph.operators {
        let Err(reason) = build_step(graph, node, files, outside(node)) else { continue };
        let reason = reason.to_string();
        let message = format!("`{}` ({}) cannot start: {reason}", node.name, node.stage.kind.name);
        let of = places.iter().find(|places| places.operator == node.name);
        match of.and_then(|places| file_in(&reason, node, places)) {
            Some(place) => {
                findings.say(place, Code::FileMissing, message, "correct the file, or name another")
            }
            None => {
                let place = of.map(|places| places.name).unwrap_or_default();
                let help = format!("change the parameters of `{}`", node.name);
                findings.say(place, Code::OutOfRange, message, help);
            }
        }
    }
}

/// Finds sockets at which two operators listen.
fn one_listener_each(graph: &Graph, places: &[Places], findings: &Findings) {
    let mut known = std::collections::BTreeMap::new();
    for node in &graph.operators {
        let Some(listening) = &node.listens else { continue };
        if let Some(other) = known.insert(&listening.socket, &node.name) {
            let place = places.iter().find(|places| places.operator == node.name);
            findings.say(
                place.map(|places| places.name).unwrap_or_default(),
                Code::DuplicateName,
                format!("`{other}` and `{}` listen at the same socket, {}", node.name, listening.socket),
                "give each a socket of its own",
            );
        }
    }
}

/// What reaches an operator. One that takes messages of ROS 2 or of another program, and names no recording, runs live alone, and starts as it does there.
fn outside(node: &OperatorNode) -> Outside {
    let takes_messages = !node.subscriptions.is_empty() || node.listens.is_some();
    let is_live_alone = takes_messages && node.files.is_empty();
    Outside { arrivals: is_live_alone.then(|| Arrivals::at_most(1)), ..Outside::default() }
}

/// The value that names the file of which a reason speaks.
fn file_in(reason: &str, node: &OperatorNode, places: &Places) -> Option<Span> {
    let is_named = |text: &str| {
        let folder = text.split('*').next().unwrap_or_default().trim_end_matches('/');
        node.files.iter().any(|file| file == text) && !folder.is_empty() && reason.contains(folder)
    };
    places.values.iter().find(|(text, _)| is_named(text)).map(|(_, span)| *span)
}
