//! Parameters as they are in the file, with their places, as JSON; and what a kind says of them.

use std::cell::RefCell;

use serde_json::{Value as Json, json};

use crate::config::faults::{Code, Fault, Findings};
use crate::config::source::{Marked, Span};
use crate::config::tree::{Entry, Node, Value};
use crate::files::Files;
use crate::params::{CheckedParams, ParamReader};
use crate::stage::Stage;

/// Entries of a mapping.
pub fn entries_to_json(entries: &[Entry]) -> Json {
    entries.iter().map(|entry| json!([entry.key.value, span(entry.key.span), node(&entry.value)])).collect()
}

/// The entries that [`entries_to_json`] gave.
pub fn entries_from_json(value: &Json) -> Vec<Entry> {
    let entry = |value: &Json| Entry {
        key: Marked::new(value[0].as_str().unwrap_or_default().to_owned(), read_span(&value[1])),
        value: read_node(&value[2]),
    };
    value.as_array().into_iter().flatten().map(entry).collect()
}

/// A place.
pub fn span(span: Span) -> Json {
    json!([span.source, span.start, span.end, span.line, span.column])
}

/// The place that [`span`] gave.
pub fn read_span(value: &Json) -> Span {
    let at = |index: usize| value[index].as_u64().and_then(|n| usize::try_from(n).ok()).unwrap_or(0);
    Span { source: at(0), start: at(1), end: at(2), line: at(3), column: at(4) }
}

fn node(node: &Node) -> Json {
    let value = match &node.value {
        Value::Nothing | Value::Refused => Json::Null,
        Value::Switch(on) => json!(on),
        Value::Text(text) => json!(text),
        Value::List(items) => json!({ "list": items.iter().map(self::node).collect::<Vec<_>>() }),
        Value::Map(entries) => json!({ "map": entries_to_json(entries) }),
    };
    json!([span(node.span), value])
}

fn read_node(value: &Json) -> Node {
    let read = match &value[1] {
        Json::Bool(on) => Value::Switch(*on),
        Json::String(text) => Value::Text(text.clone()),
        Json::Object(map) if map.contains_key("list") => {
            Value::List(map["list"].as_array().into_iter().flatten().map(read_node).collect())
        }
        Json::Object(map) if map.contains_key("map") => Value::Map(entries_from_json(&map["map"])),
        _ => Value::Nothing,
    };
    Node::new(read, read_span(&value[0]))
}

/// A fault.
pub fn fault(fault: &Fault) -> Json {
    json!({ "span": span(fault.span), "code": fault.code.name(), "message": fault.message, "help": fault.help })
}

/// Adds the fault that [`fault`](fn@fault) gave to others.
pub fn add_fault(value: &Json, findings: &Findings) {
    let text = |key: &str| value[key].as_str().unwrap_or_default().to_owned();
    let code = Code::ALL.iter().copied().find(|code| value["code"] == code.name().as_str());
    findings.say(read_span(&value["span"]), code.unwrap_or(Code::OutOfRange), text("message"), text("help"));
}

/// Parameters that a kind has read.
pub struct Read {
    /// The parameters; none where there was a fault.
    pub checked: Option<CheckedParams>,
    /// The faults.
    pub faults: Vec<Fault>,
    /// The files that they name.
    pub named: Vec<String>,
}

/// Lets a kind read its parameters; what is missing is reported at `place`.
pub fn read(stage: &Stage, entries: &[Entry], place: Span, files: &dyn Files) -> Read {
    let findings = Findings::default();
    let named = RefCell::new(Vec::new());
    let mut reader = ParamReader::new(entries, stage.kind.name, place, &findings, files, &named);
    let checked = (stage.read)(stage, &mut reader).filter(|_| findings.is_empty());
    let faults = findings.into_faults(Default::default()).list().to_vec();
    Read { checked, faults, named: named.into_inner() }
}
