//! The marked tree: YAML as it was written, each key and value with its place.

use super::faults::{Code, Findings};
use super::near::{listed, nearest, shown};
use super::source::{Marked, Span};

/// What is due where any text will do.
pub const TEXT: &str = "a text";

/// A value and where it stands.
#[derive(Clone, Debug)]
pub struct Node {
    /// Place in the text.
    pub span: Span,
    /// Its value.
    pub value: Value,
}

/// What a node is.
#[derive(Clone, Debug)]
pub enum Value {
    /// No value was written.
    Nothing,
    /// A value that was refused already: no further fault is reported.
    Refused,
    /// `true` or `false`, not in quotes.
    Switch(bool),
    /// Any other scalar as its text.
    Text(String),
    /// A sequence.
    List(Vec<Node>),
    /// A mapping, in the order of the file.
    Map(Vec<Entry>),
}

/// A key with its value.
#[derive(Clone, Debug)]
pub struct Entry {
    /// The key.
    pub key: Marked<String>,
    /// The value.
    pub value: Node,
}

impl Value {
    /// The value as text, for messages.
    pub fn words(&self) -> &'static str {
        match self {
            Self::Nothing => "nothing",
            Self::Switch(true) => "`true`",
            Self::Switch(false) => "`false`",
            Self::Refused | Self::Text(_) => "a text",
            Self::List(_) => "a list",
            Self::Map(_) => "a mapping",
        }
    }
}

impl Node {
    /// A node.
    pub fn new(value: Value, span: Span) -> Self {
        Self { span, value }
    }

    /// A scalar.
    pub fn text(text: impl Into<String>, span: Span) -> Self {
        Self::new(Value::Text(text.into()), span)
    }

    /// The entries of a mapping, to be changed; none of another value.
    pub fn entries_mut(&mut self) -> &mut [Entry] {
        match &mut self.value {
            Value::Map(entries) => entries,
            _ => &mut [],
        }
    }

    /// The value of a key of a mapping, to be changed.
    pub fn get_mut(&mut self, key: &str) -> Option<&mut Self> {
        self.entries_mut().iter_mut().find(|e| e.key.value == key).map(|e| &mut e.value)
    }

    /// Reports that another type is due here.
    pub fn refuse(&self, what: &str, expected: &str, findings: &Findings) {
        if !matches!(self.value, Value::Refused) {
            let found = self.value.words();
            let help = match self.value {
                Value::Switch(on) if expected == TEXT => {
                    format!("if it is a text, put it in quotes: `\"{on}\"`")
                }
                _ => format!("write {expected}"),
            };
            let message = format!("{what} is {found}, but must be {expected}");
            findings.say(self.span, Code::WrongShape, message, help);
        }
    }

    /// The text of a scalar, or a fault.
    pub fn scalar(&self, what: &str, expected: &str, findings: &Findings) -> Option<&str> {
        match &self.value {
            Value::Text(t) => Some(t),
            _ => {
                self.refuse(what, expected, findings);
                None
            }
        }
    }

    /// The items of a sequence, or a fault.
    pub fn list(&self, what: &str, expected: &str, findings: &Findings) -> Option<&[Node]> {
        match &self.value {
            Value::List(items) => Some(items),
            _ => {
                self.refuse(what, expected, findings);
                None
            }
        }
    }

    /// The entries of a mapping, or a fault.
    pub fn map(&self, what: &str, expected: &str, findings: &Findings) -> Option<&[Entry]> {
        match &self.value {
            Value::Map(entries) => Some(entries),
            _ => {
                self.refuse(what, expected, findings);
                None
            }
        }
    }

    /// The value of a key of a mapping.
    pub fn get(&self, key: &str) -> Option<&Node> {
        match &self.value {
            Value::Map(entries) => entries.iter().find(|e| e.key.value == key).map(|e| &e.value),
            _ => None,
        }
    }

    /// Number of nodes, this one included.
    pub fn count(&self) -> usize {
        1 + match &self.value {
            Value::List(items) => items.iter().map(Node::count).sum::<usize>(),
            Value::Map(entries) => entries.iter().map(|e| e.value.count()).sum(),
            _ => 0,
        }
    }
}

/// The entries of a mapping by the keys that it may have.
pub struct Keys<'t> {
    found: Vec<(&'static str, &'t Entry)>,
}

/// A key of a process, which people look for at operators.
const HOST: &str = "host";

impl<'t> Keys<'t> {
    /// Sorts entries by known keys. An unknown key is a fault; where a known one is near and free, its value is
    /// still read as that one, so that its faults come to light in the same pass.
    pub fn of(entries: &'t [Entry], known: &[&'static str], place: &str, findings: &Findings) -> Self {
        Self::called("key", entries, known, place, findings)
    }

    /// Like [`of`](Self::of), for keys that are often called by another name.
    pub fn called(
        noun: &str,
        entries: &'t [Entry],
        known: &[&'static str],
        place: &str,
        findings: &Findings,
    ) -> Self {
        let mut found: Vec<_> = entries
            .iter()
            .filter_map(|e| known.iter().find(|k| **k == e.key.value).map(|k| (*k, e)))
            .collect();
        for entry in entries.iter().filter(|e| !known.contains(&e.key.value.as_str())) {
            let key = entry.key.value.as_str();
            let name = shown(key);
            if key == HOST {
                findings.say(
                    entry.key.span,
                    Code::UnknownKey,
                    format!("{place} has no {noun} {name}: it is a key of a process"),
                    "write it there: `processes: { NAME: { operators: [...], host: HOST } }`",
                );
                continue;
            }
            if let Some((before, after)) = key.split_once(':').filter(|(before, _)| known.contains(before)) {
                findings.say(
                    entry.key.span,
                    Code::Syntax,
                    format!("{name} has no space behind its `:`"),
                    format!("write {}", shown(&format!("{before}: {after}"))),
                );
                continue;
            }
            let free: Vec<&str> =
                known.iter().copied().filter(|k| !found.iter().any(|(f, _)| f == k)).collect();
            let (near, given) = match findings.is_full() {
                true => (None, None),
                false => (nearest(key, free.iter().copied()), nearest(key, known.iter().copied())),
            };
            let help = match near.or(given) {
                Some(name) => format!("did you mean `{name}`?"),
                None => listed(known.iter().copied(), &format!("{noun}s")),
            };
            findings.say(entry.key.span, Code::UnknownKey, format!("{place} has no {noun} {name}"), help);
            if let Some(near) = near.and_then(|n| known.iter().find(|k| **k == n)) {
                found.push((near, entry));
            }
        }
        Self { found }
    }

    /// The entry of a key.
    pub fn get(&self, key: &str) -> Option<&'t Entry> {
        self.found.iter().find(|(k, _)| *k == key).map(|(_, e)| *e)
    }
}
