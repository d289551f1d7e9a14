//! The section `operators` as it was written.

use super::faults::{Code, Findings};
use super::fields::{check_name, missing, period, time};
use super::inputs::{self, ParsedInput};
use super::source::{Marked, Span};
use super::tree::{Entry, Keys, Node, Value};
use crate::graph::Wire;
use crate::programs::name_of;

/// Keys of an operator.
pub const KEYS: &[&str] =
    &["use", "params", "inputs", "every", "frame", "latency", "deadline", "start_within"];

/// Keys of a kind that is in a program.
pub const PROGRAM_KEYS: &[&str] = &["program", "kind"];

/// An operator as it was written.
pub struct ParsedOperator<'t> {
    /// Its name.
    pub name: Marked<String>,
    /// Its kind; `None` where it was not readable.
    pub kind: Option<Marked<String>>,
    /// Its parameters.
    pub params: Option<&'t Node>,
    /// Its inputs could not be read: none of them is missing.
    pub has_unreadable_inputs: bool,
    /// Its inputs.
    pub inputs: Vec<ParsedInput>,
    /// Period of its timer, ns.
    pub every: Option<Marked<u64>>,
    /// `every` stands there, readable or not.
    pub has_every: Option<Span>,
    /// Its frame.
    pub frame: Option<Marked<String>>,
    /// `frame` stands there, readable or not.
    pub has_frame: Option<Span>,
    /// Time that the simulated executor charges, ns.
    pub latency: u64,
    /// Place of `latency`.
    pub has_latency: Option<Span>,
    /// Longest step, ns.
    pub deadline: Option<u64>,
    /// Longest time from a tick of its timer to the activation, ns.
    pub start_within: Option<Marked<u64>>,
    /// What it is the far end of, if it is that of a link.
    pub link: Option<Wire>,
}

impl ParsedOperator<'_> {
    /// With a name and nothing else.
    pub fn named(name: Marked<String>) -> Self {
        Self {
            name,
            kind: None,
            params: None,
            has_unreadable_inputs: false,
            inputs: Vec::new(),
            every: None,
            has_every: None,
            frame: None,
            has_frame: None,
            latency: 0,
            has_latency: None,
            deadline: None,
            start_within: None,
            link: None,
        }
    }
}

/// Shortest period of a timer, ns: a shorter one has no time to do anything.
const SHORTEST_PERIOD: u64 = 1_000;

/// Reads the section.
pub fn read<'t>(entry: &'t Entry, findings: &Findings) -> Vec<ParsedOperator<'t>> {
    let expected = "a mapping from names to operators";
    let Some(entries) = entry.value.map("`operators`", expected, findings) else { return Vec::new() };
    if entries.is_empty() && !findings.any_within(entry.value.span) {
        findings.say(
            entry.key.span,
            Code::MissingKey,
            "`operators` is empty: a pipeline needs at least one operator",
            "add one, for example `console: { use: console, every: 20 ms }`",
        );
    }
    entries.iter().map(|e| operator(e, findings)).collect()
}

fn long_enough(every: Marked<u64>, findings: &Findings) -> Option<Marked<u64>> {
    if every.value >= SHORTEST_PERIOD {
        return Some(every);
    }
    findings.say(
        every.span,
        Code::OutOfRange,
        "`every` must be at least 1 us: nothing is done in a shorter time",
        "write a longer time, for example `10 ms`",
    );
    None
}

/// The kind of an operator: its name, or a program with the name that the kind has there.
fn kind(node: &Node, findings: &Findings) -> Option<Marked<String>> {
    let Value::Map(entries) = &node.value else {
        let text = node.scalar("`use`", "the kind of the operator", findings)?;
        return Some(Marked::new(text.to_owned(), node.span));
    };
    let keys = Keys::of(entries, PROGRAM_KEYS, "`use`", findings);
    let text = |key: &str, example: &str| match keys.get(key) {
        Some(e) => e.value.scalar(&format!("`{key}`"), example, findings),
        None => {
            missing("`use`", key, example, node.span.first(1), findings);
            None
        }
    };
    let (program, kind) = (text("program", "./my_op"), text("kind", "my.smoother"));
    Some(Marked::new(name_of(program?, kind?), node.span))
}

fn operator<'t>(entry: &'t Entry, findings: &Findings) -> ParsedOperator<'t> {
    let name = entry.key.clone();
    check_name(&name, "an operator", findings);
    let mut parsed = ParsedOperator::named(name);
    let place = "an operator";
    let Some(entries) =
        entry.value.map(&format!("`{}`", parsed.name.value), "{ use: family.kind }", findings)
    else {
        return parsed;
    };
    let keys = Keys::of(entries, KEYS, place, findings);
    match keys.get("use") {
        Some(e) => {
            parsed.kind = kind(&e.value, findings);
        }
        None => missing(place, "use", "family.kind", parsed.name.span, findings),
    }
    parsed.params = keys.get("params").map(|e| &e.value);
    parsed.inputs = keys.get("inputs").map(|e| inputs::read(&e.value, findings)).unwrap_or_default();
    parsed.has_unreadable_inputs =
        keys.get("inputs").is_some_and(|e| !matches!(e.value.value, Value::Map(_)));
    parsed.has_every = keys.get("every").map(|e| e.key.span);
    parsed.every = keys.get("every").and_then(|e| period(e, findings)).and_then(|e| long_enough(e, findings));
    parsed.has_frame = keys.get("frame").map(|e| e.key.span);
    parsed.frame = keys.get("frame").and_then(|e| {
        let text = e.value.scalar("`frame`", "the name of a frame", findings)?;
        Some(Marked::new(text.to_owned(), e.value.span))
    });
    let latency = keys.get("latency").and_then(|e| time(e, findings));
    parsed.has_latency = latency.as_ref().map(|t| t.span);
    parsed.latency = latency.map_or(0, |t| t.value);
    parsed.deadline = keys.get("deadline").and_then(|e| period(e, findings)).map(|t| t.value);
    parsed.start_within = keys.get("start_within").and_then(|e| period(e, findings));
    parsed
}
