//! The inputs of an operator as they were written: where samples come from and how they are consumed.

use super::contracts::late_input;
use super::faults::{Code, Findings};
use super::fields::{count, missing, period};
use super::near::shown;
use super::source::{Marked, Span};
use super::tree::{Entry, Keys, Node, Value};
use crate::graph::LateInput;

/// Keys of an input.
pub const KEYS: &[&str] = &["from", "latest", "queue", "sync", "delay", "max_age", "else"];
/// Longest queue.
pub const LONGEST_QUEUE: u32 = 4096;

/// An input as it was written.
pub struct ParsedInput {
    /// Its name.
    pub name: Marked<String>,
    /// Where its samples come from; `None` where it was not readable.
    pub from: Option<Marked<Topic>>,
    /// How it is consumed, where the config says so.
    pub policy: Option<Marked<ParsedPolicy>>,
    /// A sample is seen this long after its stamp, ns.
    pub delay: u64,
    /// How old its samples may be, ns.
    pub max_age: Option<Marked<u64>>,
    /// What the operator does about an older one.
    pub otherwise: LateInput,
}

/// A topic as it was written.
#[derive(Clone, Debug)]
pub struct Topic {
    /// Name of the operator.
    pub operator: Marked<String>,
    /// Name of its output.
    pub port: Marked<String>,
}

/// A consumption policy as it was written.
#[derive(Clone, Debug)]
pub enum ParsedPolicy {
    /// The newest sample.
    Latest,
    /// In order, at most so many waiting.
    Queue(u32),
    /// In step with other inputs.
    Sync {
        /// The other inputs.
        with: Vec<Marked<String>>,
        /// Greatest distance of the origins, ns.
        within: u64,
    },
}

/// Reads `inputs:`.
pub fn read(node: &Node, findings: &Findings) -> Vec<ParsedInput> {
    let Some(entries) = node.map("`inputs`", "a mapping from inputs to topics", findings) else {
        return Vec::new();
    };
    entries.iter().map(|e| input(e, findings)).collect()
}

fn input(entry: &Entry, findings: &Findings) -> ParsedInput {
    let name = entry.key.clone();
    let mut parsed =
        ParsedInput { name, from: None, policy: None, delay: 0, max_age: None, otherwise: LateInput::Count };
    let Value::Map(entries) = &entry.value.value else {
        parsed.from = topic(&entry.value, findings);
        return parsed;
    };
    let keys = Keys::of(entries, KEYS, "an input", findings);
    match keys.get("from") {
        Some(e) => parsed.from = topic(&e.value, findings),
        None => missing("an input", "from", "operator.port", parsed.name.span, findings),
    }
    parsed.delay = keys.get("delay").and_then(|e| period(e, findings)).map_or(0, |t| t.value);
    parsed.max_age = keys.get("max_age").and_then(|e| period(e, findings));
    if let Some(entry) = keys.get("else") {
        parsed.otherwise = late_input(entry, findings).unwrap_or(LateInput::Count);
        if keys.get("max_age").is_none() {
            missing("an input with `else`", "max_age", "60 ms", entry.key.span, findings);
        }
    }
    let mut policies = Vec::new();
    policies.extend(keys.get("latest").and_then(|e| latest(e, findings)));
    policies.extend(keys.get("queue").and_then(|e| queue(e, findings)));
    policies.extend(keys.get("sync").and_then(|e| sync(e, &parsed.name.value, findings)));
    policies.sort_by_key(|p| p.span);
    if let [_, second, ..] = policies.as_slice() {
        findings.say(
            second.span,
            Code::Policy,
            "an input is consumed in one way, but here is a second one",
            "keep one of `latest`, `queue` and `sync`",
        );
    }
    parsed.policy = policies.into_iter().next();
    parsed
}

fn latest(entry: &Entry, findings: &Findings) -> Option<Marked<ParsedPolicy>> {
    if let Value::Text(_) | Value::Switch(false) = &entry.value.value {
        let found = match &entry.value.value {
            Value::Text(text) => shown(text),
            other => other.words().to_owned(),
        };
        findings.say(
            entry.value.span,
            Code::Policy,
            format!("`latest` is {found}, but it can only be switched on"),
            "write `latest: true`, or `queue: N` to take every sample",
        );
        return None;
    }
    if !matches!(entry.value.value, Value::Switch(true)) {
        entry.value.refuse("`latest`", "`true`", findings);
        return None;
    }
    Some(Marked::new(ParsedPolicy::Latest, entry.key.span))
}

fn queue(entry: &Entry, findings: &Findings) -> Option<Marked<ParsedPolicy>> {
    let length = count(entry, 1, LONGEST_QUEUE, findings)?;
    Some(Marked::new(ParsedPolicy::Queue(length), entry.key.span))
}

fn sync(entry: &Entry, own: &str, findings: &Findings) -> Option<Marked<ParsedPolicy>> {
    let expected = "{ with: [input], within: 5 ms }";
    let entries = entry.value.map("`sync`", expected, findings)?;
    let keys = Keys::of(entries, &["with", "within"], "`sync`", findings);
    let with = match keys.get("with") {
        Some(e) => partners(&e.value, own, findings),
        None => {
            missing("`sync`", "with", "[input]", entry.key.span, findings);
            None
        }
    };
    let within = match keys.get("within") {
        Some(e) => super::fields::time(e, findings).map(|t| t.value),
        None => {
            missing("`sync`", "within", "5 ms", entry.key.span, findings);
            None
        }
    };
    Some(Marked::new(ParsedPolicy::Sync { with: with?, within: within? }, entry.key.span))
}

fn partners(node: &Node, own: &str, findings: &Findings) -> Option<Vec<Marked<String>>> {
    let items = node.list("`with`", "a list of other inputs of this operator", findings)?;
    if items.is_empty() {
        findings.say(
            node.span,
            Code::Policy,
            "`sync` names no other input to be in step with",
            "name at least one, or remove `sync`",
        );
        return None;
    }
    let mut with = Vec::new();
    for item in items {
        let name = item.scalar("a partner", "the name of an input", findings)?;
        if name == own {
            findings.say(
                item.span,
                Code::Policy,
                format!("{} cannot be in step with itself", shown(name)),
                "name another input of this operator",
            );
        } else {
            with.push(Marked::new(name.to_owned(), item.span));
        }
    }
    Some(with)
}

/// Reads `operator.port`.
pub fn topic(node: &Node, findings: &Findings) -> Option<Marked<Topic>> {
    let text = node.scalar("a topic", "`operator.port`", findings)?;
    topic_at(text, node.span, findings)
}

/// Reads `operator.port` where the text stands at a place.
pub fn topic_at(text: &str, span: Span, findings: &Findings) -> Option<Marked<Topic>> {
    match text.split_once('.') {
        Some((operator, port)) if !operator.is_empty() && !port.is_empty() => {
            // Quotes shift the text within its place.
            let shift = (span.end - span.start).saturating_sub(text.len()) / 2;
            let start = span.start + shift;
            let dot = start + operator.len();
            let column = span.column + shift;
            let first = Span { start, end: dot, column, ..span };
            let last = Span {
                start: dot + 1,
                end: dot + 1 + port.len(),
                column: column + operator.chars().count() + 1,
                ..span
            };
            let operator = Marked::new(operator.to_owned(), first);
            Some(Marked::new(Topic { operator, port: Marked::new(port.to_owned(), last) }, span))
        }
        _ => {
            let name = text.trim_matches('.');
            findings.say(
                span,
                Code::WrongShape,
                format!("{} is not a topic: a topic is `operator.port`", shown(text)),
                format!(
                    "write `{}.port` with the name of the output",
                    if name.is_empty() { "operator" } else { name }
                ),
            );
            None
        }
    }
}
