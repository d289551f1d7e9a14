//! `--set operator.param=value`: what the command line puts in the place of what the file says. `operator.use`,
//! `operator.every` and other keys of an operator, and `operator.inputs.INPUT`, are set in the same way, and so are parts
//! of other sections, such as `links.valves.datagram.delay`, or the whole of them, such as `contracts`.

use super::document;
use super::faults::{Code, Findings};
use super::near::{shown, suggestion};
use super::operators;
use super::source::{Marked, Span};
use super::tree::{Entry, Node, Value};
use super::yaml;

/// Sections that arguments reach by their names, where no operator has that name.
const SECTIONS: &[&str] = &["frames", "links", "processes", "record", "contracts"];

/// What arguments say of the pipeline as a whole.
#[derive(Default)]
pub struct Whole {
    /// `seed=N`.
    pub seed: Option<u64>,
    /// `host=NAME`: the part that runs.
    pub host: Option<Marked<String>>,
}

/// Applies the arguments to the tree, in their order; the first has the number `first` among the texts. Returns what they
/// say of the whole.
pub fn apply(root: &mut Node, sets: &[String], first: usize, findings: &Findings) -> Whole {
    let mut whole = Whole::default();
    for (number, text) in sets.iter().enumerate() {
        let source = first + number;
        let all = Span { source, start: 0, end: text.len(), line: 1, column: 1 };
        let Some((path, value)) = text.split_once('=') else {
            let message = format!("{} sets nothing: `=` is missing", shown(text));
            findings.say(all, Code::Set, message, "write `--set operator.param=value`");
            continue;
        };
        let offset = path.len() + 1;
        let node = if value.starts_with('*') {
            // No pipeline has an alias, so that a pattern such as `*.tif` needs no second quotes on a command line.
            Some(Node::text(
                value,
                Span { start: offset, column: all.column + path.chars().count() + 1, ..all },
            ))
        } else {
            yaml::parse(value, source, offset, findings)
        };
        let Some(node) = node.filter(|n| !matches!(n.value, Value::Nothing)) else {
            if value.trim().is_empty() {
                let message = format!("{} sets no value", shown(text));
                findings.say(all, Code::Set, message, format!("write `--set {path}=value`"));
            }
            continue;
        };
        if path == "seed" {
            whole.seed = document::seed(&node, findings);
        } else if path == "host" {
            let name = node.scalar("`host`", "the name of a host", findings);
            whole.host = name.map(|name| Marked::new(name.to_owned(), node.span));
        } else {
            put(root, path, node, all, findings);
        }
    }
    whole
}

/// Puts a value at `operator.key` or `operator.param.field`.
pub fn put(root: &mut Node, path: &str, node: Node, all: Span, findings: &Findings) {
    let steps = steps(path, all);
    let [operator, rest @ ..] = steps.as_slice() else { return };
    let is_named = steps.iter().all(|step| !step.value.is_empty());
    if is_named && SECTIONS.contains(&operator.value.as_str()) && !has_operator(root, &operator.value) {
        put_under(root, &of_section(&steps), node, findings);
        return;
    }
    if rest.is_empty() || !is_named {
        let message = format!("{} names no parameter", shown(path));
        findings.say(all.first(path.len()), Code::Set, message, "write `--set operator.param=value`");
        return;
    }
    let Some(found) = find_operator(root, operator, findings) else { return };
    let mut at = found;
    let key = rest[0].value.as_str();
    // The keys of an input, or all of it: `law.inputs.state={ from: filter.state, queue: 4 }`.
    let is_input = key == "inputs";
    let is_key = rest.len() == 1 && operators::KEYS.contains(&key) && key != "params";
    if !is_key && !is_input {
        let Some(params) = child(at, &Marked::new("params".into(), operator.span), findings) else { return };
        at = params;
    }
    put_under(at, rest, node, findings);
}

/// The keys of a section by the steps of a path: a link has the name of its topic, with a dot.
fn of_section(steps: &[Marked<String>]) -> Vec<Marked<String>> {
    match steps {
        [section, operator, port, rest @ ..] if section.value == "links" => {
            let topic = format!("{}.{}", operator.value, port.value);
            let span = Span { end: port.span.end, ..operator.span };
            [&[section.clone(), Marked::new(topic, span)], rest].concat()
        }
        _ => steps.to_vec(),
    }
}

/// Puts a value at a path of keys, and makes the mappings that are not there.
fn put_under(root: &mut Node, path: &[Marked<String>], node: Node, findings: &Findings) {
    let Some((last, groups)) = path.split_last() else { return };
    let mut at = root;
    for group in groups {
        match child(at, group, findings) {
            Some(next) => at = next,
            None => return,
        }
    }
    let Value::Map(entries) = &mut at.value else { return };
    match entries.iter_mut().find(|e| e.key.value == last.value) {
        // The key is the argument's now, so that a fault about it names the argument.
        Some(entry) => *entry = Entry { key: last.clone(), value: node },
        None => entries.push(Entry { key: last.clone(), value: node }),
    }
}

fn steps(path: &str, all: Span) -> Vec<Marked<String>> {
    let mut start = 0;
    path.split('.')
        .map(|step| {
            let column = all.column + path[..start].chars().count();
            let from = all.start + start;
            let span = Span { start: from, end: from + step.len(), column, ..all };
            start += step.len() + 1;
            Marked::new(step.to_owned(), span)
        })
        .collect()
}

/// Whether a path is that of a part of an operator or of a section; else adds the fault.
pub fn is_place(root: &Node, path: &str, all: Span, findings: &Findings) -> bool {
    let steps = steps(path, all);
    let [first, rest @ ..] = steps.as_slice() else { return false };
    let is_section = SECTIONS.contains(&first.value.as_str());
    if has_operator(root, &first.value) || is_section {
        let is_whole = steps.iter().all(|step| !step.value.is_empty()) && (is_section || !rest.is_empty());
        if !is_whole {
            let message = format!("{} names no place", shown(path));
            findings.say(all, Code::Set, message, "write `operator.param`, as for `--set`");
        }
        return is_whole;
    }
    let operators = root.get("operators").map(|node| &node.value);
    let names: Vec<&str> = match operators {
        Some(Value::Map(entries)) => entries.iter().map(|e| e.key.value.as_str()).collect(),
        _ => Vec::new(),
    };
    findings.say(
        first.span,
        Code::UnknownOperator,
        format!("there is no operator {}", shown(&first.value)),
        suggestion(&first.value, names.iter().copied(), "operators", findings),
    );
    false
}

fn has_operator(root: &Node, name: &str) -> bool {
    root.get("operators").is_some_and(|operators| operators.get(name).is_some())
}

fn find_operator<'t>(root: &'t mut Node, name: &Marked<String>, findings: &Findings) -> Option<&'t mut Node> {
    let Value::Map(sections) = &mut root.value else { return None };
    let section = sections.iter_mut().find(|e| e.key.value == "operators")?;
    let Value::Map(entries) = &mut section.value.value else { return None };
    let number = entries.iter().position(|e| e.key.value == name.value);
    if number.is_none() {
        let names: Vec<&str> = entries.iter().map(|e| e.key.value.as_str()).collect();
        findings.say(
            name.span,
            Code::UnknownOperator,
            format!("there is no operator {}", shown(&name.value)),
            suggestion(&name.value, names.iter().copied(), "operators", findings),
        );
    }
    entries.get_mut(number?).map(|e| &mut e.value)
}

/// The mapping under a key, made where it is not there.
fn child<'t>(at: &'t mut Node, key: &Marked<String>, findings: &Findings) -> Option<&'t mut Node> {
    let Value::Map(entries) = &mut at.value else { return None };
    let number = match entries.iter().position(|e| e.key.value == key.value) {
        Some(number) => number,
        None => {
            let value = Node::new(Value::Map(Vec::new()), key.span);
            entries.push(Entry { key: key.clone(), value });
            entries.len() - 1
        }
    };
    let node = &mut entries.get_mut(number)?.value;
    if matches!(node.value, Value::Nothing) {
        node.value = Value::Map(Vec::new());
    }
    if !matches!(node.value, Value::Map(_)) {
        let message = format!("{} is {} and has no parts", shown(&key.value), node.value.words());
        findings.say(key.span, Code::Set, message, "set the whole of it");
        return None;
    }
    Some(node)
}
