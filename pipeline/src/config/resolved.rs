//! The whole pipeline as it is run: what files, arguments and defaults say, each value with where it came from.

use std::collections::BTreeMap;

use serde_json::{Value as Json, json};

use super::check::{Expansion, Purpose, Request};
use super::faults::{Faults, Findings};
use super::machine::Machine;
use super::source::{Marked, Source, Span};
use super::tree::{Entry, Node, Value};
use super::{document, processes, write, yaml};
use crate::graph::{Graph, Restart};
use crate::operator::{Files, Policy, Registry};
use crate::params::{ParamField, ParamType, Presence};

/// Source number of a default: it is in no text.
const DEFAULT: Span = Span { source: usize::MAX, start: 0, end: 0, line: 1, column: 1 };

/// A checked pipeline with all of its values.
pub struct Resolved {
    /// The graph.
    pub graph: Graph,
    tree: Node,
    files: Vec<Source>,
    sets: Vec<String>,
    paths: BTreeMap<Span, String>,
}

/// Checks a pipeline that is to run on this machine, and gives all of its values.
pub fn resolve_for(
    machine: &Machine,
    text: &str,
    file_name: &str,
    sets: &[String],
    registry: &Registry,
    files: &dyn Files,
) -> Result<Resolved, Faults> {
    let purpose = Purpose::Run;
    let request = Request { machine, purpose, text, file_name, sets, registry, files };
    let (graph, Expansion { texts, whole, replaced, .. }) = request.checked()?;
    let mut tree = whole.unwrap_or_else(|| group([]));
    // `--set seed=9` is no part of the tree.
    if let Some(number) = sets.iter().rposition(|set| set.starts_with("seed=")) {
        let span =
            Span { source: texts.len() + number, start: 0, end: sets[number].len(), line: 1, column: 1 };
        match tree.get_mut("seed") {
            Some(seed) => *seed = Node::text(graph.seed.to_string(), span),
            None => add(&mut tree, "seed", Node::text(graph.seed.to_string(), span)),
        }
    }
    fill(&mut tree, &graph);
    let files = texts.into_iter().map(|file| file.source).collect();
    Ok(Resolved { graph, tree, files, sets: sets.to_vec(), paths: replaced.paths })
}

impl Resolved {
    /// A pipeline file of all values, each with a comment that says where it came from. It is the same pipeline in the
    /// folder of the pipeline file.
    pub fn to_yaml(&self) -> String {
        let note = |node: &Node, _: &Node| match &node.value {
            Value::Map(entries) if !entries.is_empty() => None,
            Value::List(items) if items.iter().any(|item| matches!(item.value, Value::Map(_))) => None,
            _ => Some(self.origin(node.span)),
        };
        write::tree(&self.tree, &note)
    }

    /// All values as a JSON list: `path`, `value`, and where it came `from`: `default`, `file` with `file`, `line` and
    /// `column`, or `argument` with `argument`. A path that named a variable has `written`, the text with its name.
    pub fn to_json(&self) -> Json {
        let mut values = Vec::new();
        self.list(&self.tree, &mut Vec::new(), &mut values);
        Json::Array(values)
    }

    fn list(&self, node: &Node, path: &mut Vec<String>, values: &mut Vec<Json>) {
        match &node.value {
            Value::Map(entries) if !entries.is_empty() => {
                for entry in entries {
                    path.push(entry.key.value.clone());
                    self.list(&entry.value, path, values);
                    path.pop();
                }
            }
            Value::List(items) if items.iter().any(|item| matches!(item.value, Value::Map(_))) => {
                for (number, item) in items.iter().enumerate() {
                    path.push(number.to_string());
                    self.list(item, path, values);
                    path.pop();
                }
            }
            _ => {
                let span = node.span;
                let mut value = json!({ "path": path.clone(), "value": plain(node) });
                let from = match (span.source == DEFAULT.source, self.files.get(span.source)) {
                    (true, _) => json!({ "from": "default" }),
                    (_, Some(file)) => {
                        json!({ "from": "file", "file": file.name, "line": span.line, "column": span.column })
                    }
                    _ => json!({ "from": "argument", "argument": self.argument(span) }),
                };
                let written = self.written(span).map(|text| json!({ "written": text }));
                if let Json::Object(map) = &mut value {
                    let parts = [Some(from), written].into_iter().flatten();
                    map.extend(parts.filter_map(|part| part.as_object().cloned()).flatten());
                }
                values.push(value);
            }
        }
    }

    fn origin(&self, span: Span) -> String {
        let written = self.written(span).map_or_else(String::new, |text| format!(", {text}"));
        match (span.source == DEFAULT.source, self.files.get(span.source)) {
            (true, _) => "default".to_owned(),
            (_, Some(file)) => format!("{}:{}{written}", file.name, span.line),
            _ => format!("--set {}{written}", self.argument(span)),
        }
    }

    fn argument(&self, span: Span) -> &str {
        self.sets.get(span.source.saturating_sub(self.files.len())).map_or("", String::as_str)
    }

    /// The text of a path that named a variable.
    fn written(&self, span: Span) -> Option<&str> {
        self.paths.get(&span)?;
        let text = self.files.get(span.source).map_or_else(|| self.argument(span), |file| &file.text);
        let text = text.get(span.start..span.end)?.trim_end();
        (text.contains("${") || text.contains("~/")).then_some(text)
    }
}

/// A value as JSON; quantities are texts.
fn plain(node: &Node) -> Json {
    match &node.value {
        Value::Nothing | Value::Refused => Json::Null,
        Value::Switch(on) => json!(on),
        Value::Text(text) => json!(text),
        Value::List(items) => items.iter().map(plain).collect(),
        Value::Map(entries) => entries.iter().map(|e| (e.key.value.clone(), plain(&e.value))).collect(),
    }
}

/// Adds all defaults to the tree of a checked pipeline.
fn fill(root: &mut Node, graph: &Graph) {
    add(root, "seed", Node::text("1", DEFAULT));
    add(root, "record", group([("topics", Node::text("sources", DEFAULT))]));
    if let Value::Map(sections) = &mut root.value {
        sections.sort_by_key(|e| document::KEYS.iter().position(|key| *key == e.key.value));
    }
    for Entry { key, value } in root.entries_mut() {
        match key.value.as_str() {
            "frames" => value.entries_mut().iter_mut().for_each(|frame| {
                let angle = || Node::text("0 deg", DEFAULT);
                add(
                    &mut frame.value,
                    "rotation",
                    Node::new(Value::List(vec![angle(), angle(), angle()]), DEFAULT),
                );
            }),
            "operators" => value.entries_mut().iter_mut().for_each(|entry| operator(entry, graph)),
            "links" => value
                .entries_mut()
                .iter_mut()
                .for_each(|link| add(&mut link.value, "delay", Node::text("0 s", DEFAULT))),
            "processes" => value.entries_mut().iter_mut().for_each(|entry| process(&mut entry.value)),
            "ros2" => add(value, "domain", Node::text("0", DEFAULT)),
            "contracts" => items(value).iter_mut().for_each(|contract| {
                add(contract, "share", Node::text("100 %", DEFAULT));
                add(contract, "else", Node::text("count", DEFAULT));
            }),
            _ => {}
        }
    }
}

fn operator(entry: &mut Entry, graph: &Graph) {
    let Some(number) = graph.operator(&entry.key.value) else { return };
    let node = &graph.operators[number];
    let stage = &node.stage;
    for input in entry.value.get_mut("inputs").map(Node::entries_mut).unwrap_or_default() {
        if let Some(port) = stage.kind.inputs.iter().position(|port| port.name == input.key.value) {
            policy(&mut input.value, node.inputs[port].policy);
        }
    }
    add(&mut entry.value, "latency", Node::text("0 s", DEFAULT));
    if !stage.fields.is_empty() {
        add(&mut entry.value, "params", group([]));
    }
    if let Some(params) = entry.value.get_mut("params") {
        fields(params, stage.fields);
    }
}

/// How an input is consumed.
fn policy(input: &mut Node, policy: Policy) {
    if let Value::Text(_) = input.value {
        let from = input.clone();
        *input = group([("from", from)]);
    }
    if ["queue", "latest", "sync"].iter().all(|key| input.get(key).is_none()) {
        match policy {
            Policy::Queue(count) => add(input, "queue", Node::text(count.to_string(), DEFAULT)),
            Policy::Latest => add(input, "latest", Node::new(Value::Switch(true), DEFAULT)),
            // One input of the set says so, or the kind does.
            Policy::Sync { .. } => {}
        }
    }
    if input.get("max_age").is_some() {
        add(input, "else", Node::text("count", DEFAULT));
    }
}

/// Adds the defaults of a group of parameters.
fn fields(group: &mut Node, all: &[ParamField]) {
    for field in all {
        if group.get_mut(field.name).is_none()
            && let Some(value) = default(field)
        {
            add(group, field.name, value);
        }
        if let Some(value) = group.get_mut(field.name) {
            inner(value, field.ty);
        }
    }
}

/// Adds the defaults inside of a value.
fn inner(node: &mut Node, ty: ParamType) {
    match (ty, &mut node.value) {
        (ParamType::Group(all), Value::Map(_)) => fields(node, all),
        (ParamType::List { of, .. }, Value::List(items)) => {
            items.iter_mut().for_each(|item| inner(item, *of))
        }
        _ => {}
    }
}

/// The value of a parameter that is not given, if it has one.
fn default(field: &ParamField) -> Option<Node> {
    match (field.default, field.ty) {
        (Some(text), ParamType::List { .. } | ParamType::Group(_)) => {
            yaml::parse(text, DEFAULT.source, 0, &Findings::default())
        }
        (Some(text), ParamType::Switch) => Some(Node::new(Value::Switch(text == "true"), DEFAULT)),
        (Some(text), _) => Some(Node::text(text, DEFAULT)),
        (None, ParamType::Group(_)) if field.presence == Presence::Group => {
            Some(Node::new(Value::Map(Vec::new()), DEFAULT))
        }
        _ => None,
    }
}

fn process(node: &mut Node) {
    if let Value::List(_) = node.value {
        let operators = node.clone();
        *node = group([("operators", operators)]);
    }
    if let Restart::OnFault { limit, backoff } = processes::RESTART {
        let limit = Node::text(limit.to_string(), DEFAULT);
        let backoff = Node::text(format!("{} ms", backoff / 1_000_000), DEFAULT);
        add(node, "restart", group([("limit", limit), ("backoff", backoff)]));
    }
}

/// A mapping of defaults.
fn group<const N: usize>(parts: [(&str, Node); N]) -> Node {
    Node::new(Value::Map(parts.into_iter().map(|(key, value)| named(key, value)).collect()), DEFAULT)
}

fn named(key: &str, value: Node) -> Entry {
    Entry { key: Marked::new(key.to_owned(), DEFAULT), value }
}

/// Adds an entry to a mapping that does not have it.
fn add(node: &mut Node, key: &str, value: Node) {
    if let Value::Nothing = node.value {
        node.value = Value::Map(Vec::new());
    }
    if let Value::Map(entries) = &mut node.value
        && !entries.iter().any(|e| e.key.value == key)
    {
        entries.push(named(key, value));
    }
}

fn items(node: &mut Node) -> &mut [Node] {
    match &mut node.value {
        Value::List(items) => items,
        _ => &mut [],
    }
}
