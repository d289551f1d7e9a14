//! From YAML text to the marked tree.
//!
//! Anchors, aliases, merge keys, tags and further documents are refused: a config says everything in its place, and a
//! short text cannot expand to a long one.

use std::borrow::Cow;
use std::collections::BTreeMap;

use saphyr_parser::{Event, Parser, ScalarStyle, ScanError, Tag};

use super::faults::{Code, Complaint, Findings};
use super::near::shown;
use super::places::Places;
pub use super::source::MOST_BYTES;
use super::source::{Marked, Span};
use super::syntax::Mistake;
use super::tree::{Entry, Node, Value};

/// Deepest nesting.
pub const DEEPEST: usize = 24;

/// Reads a text that stands `offset` bytes into its source. `None` where the text is no YAML, which is a fault.
pub fn parse(text: &str, source: usize, offset: usize, findings: &Findings) -> Option<Node> {
    let places = Places::new(text, source, offset);
    if text.len() > MOST_BYTES {
        findings.say(
            places.at(0, 0, 1, 0),
            Code::TooLarge,
            format!("the text has more than the {MOST_BYTES} bytes that a pipeline may have"),
            "split it into several pipelines",
        );
        return None;
    }
    let mut growth = Growth { places, findings, open: Vec::new(), root: None };
    let mut parser = Parser::new_from_str(text);
    let mut documents = 0;
    while let Some(event) = parser.next_event() {
        let (event, span) = match event {
            Ok(pair) => pair,
            Err(error) => {
                growth.syntax(&error);
                return None;
            }
        };
        let span = growth.places.between(span.start, span.end);
        if matches!(event, Event::DocumentStart(_)) {
            documents += 1;
            if documents > 1 {
                findings.say(
                    span,
                    Code::NotSupported,
                    "a second document begins here, but a file holds one pipeline",
                    "move it into a file of its own",
                );
                break;
            }
        }
        if !growth.take(event, span) {
            return None;
        }
    }
    growth.root
}

/// A collection that is not closed yet.
enum Open {
    List { span: Span, items: Vec<Node> },
    Map { span: Span, entries: Vec<Entry>, seen: BTreeMap<String, usize>, key: Key },
}

/// The key that waits for its value.
enum Key {
    None,
    Known(Marked<String>),
    /// A key that was refused: its value is dropped.
    Refused,
}

/// The tree while it grows.
struct Growth<'t> {
    places: Places<'t>,
    findings: &'t Findings,
    open: Vec<Open>,
    root: Option<Node>,
}

impl Growth<'_> {
    /// Takes an event. Returns false if no further event makes sense.
    fn take(&mut self, event: Event<'_>, span: Span) -> bool {
        match event {
            Event::Scalar(text, style, anchor, tag) => {
                self.marks(anchor, tag, span);
                let nothing = style == ScalarStyle::Plain
                    && matches!(text.as_ref(), "" | "~" | "null" | "Null" | "NULL");
                let value = match text.as_ref() {
                    _ if nothing => Value::Nothing,
                    "true" if style == ScalarStyle::Plain => Value::Switch(true),
                    "false" if style == ScalarStyle::Plain => Value::Switch(false),
                    _ => Value::Text(text.into_owned()),
                };
                self.place(Node::new(value, span));
            }
            Event::Alias(_) => {
                self.findings.say(
                    span,
                    Code::NotSupported,
                    "an alias repeats what is defined elsewhere, which a pipeline file does not allow",
                    "write the value itself",
                );
                self.place(Node::new(Value::Refused, span));
            }
            Event::SequenceStart(anchor, tag) => {
                self.marks(anchor, tag, span);
                self.open.push(Open::List { span, items: Vec::new() });
            }
            Event::MappingStart(anchor, tag) => {
                self.marks(anchor, tag, span);
                let seen = BTreeMap::new();
                self.open.push(Open::Map { span, entries: Vec::new(), seen, key: Key::None });
            }
            Event::SequenceEnd | Event::MappingEnd => match self.open.pop() {
                Some(Open::List { span: from, items }) => {
                    self.place(Node::new(Value::List(items), Span { end: span.end.max(from.end), ..from }));
                }
                Some(Open::Map { span: from, entries, .. }) => {
                    self.place(Node::new(Value::Map(entries), Span { end: span.end.max(from.end), ..from }));
                }
                None => {}
            },
            _ => {}
        }
        if self.open.len() > DEEPEST {
            self.findings.add(span, too_deep());
            return false;
        }
        true
    }

    fn marks(&self, anchor: usize, tag: Option<Cow<'_, Tag>>, span: Span) {
        if anchor > 0 {
            self.findings.say(
                span,
                Code::NotSupported,
                "an anchor (`&`) marks this for repetition, but a pipeline says each thing where it holds",
                "remove the anchor and write the value where it is needed",
            );
        }
        if let Some(tag) = tag {
            let handle = if tag.is_yaml_core_schema() { "!!" } else { &tag.handle };
            let tag = shown(&format!("{handle}{}", tag.suffix));
            self.findings.say(
                span,
                Code::NotSupported,
                format!("the tag {tag} says a type, but the key says it already"),
                "remove the tag",
            );
        }
    }

    /// Puts a finished node where it belongs.
    fn place(&mut self, mut node: Node) {
        match self.open.last_mut() {
            None => self.root = Some(node),
            Some(Open::List { items, .. }) => items.push(node),
            Some(Open::Map { entries, seen, key, .. }) => match std::mem::replace(key, Key::None) {
                Key::None => *key = self.findings.key(node, seen),
                Key::Known(known) => {
                    // An empty value has no place of its own: the key stands for it.
                    if matches!(node.value, Value::Nothing) && node.span.start >= node.span.end {
                        node.span = known.span;
                    }
                    entries.push(Entry { key: known, value: node });
                }
                Key::Refused => {}
            },
        }
    }

    /// Says what is wrong where the scanner found no YAML.
    fn syntax(&self, error: &ScanError) {
        let place = self.places.between(*error.marker(), *error.marker());
        // The scanner reads ahead and has a limit of its own.
        if error.info().contains("recursion") {
            return self.findings.add(place, too_deep());
        }
        let open = self.open.iter().rev().find_map(|open| {
            let (Open::List { span, .. } | Open::Map { span, .. }) = open;
            let first = self.places.text.as_bytes().get(span.start.wrapping_sub(self.places.offset));
            first.filter(|b| matches!(b, b'{' | b'[')).map(|b| (*span, char::from(*b)))
        });
        let slip = Mistake::new(&self.places, error.info(), place, open).found();
        self.findings.say(slip.at, Code::Syntax, slip.message, slip.help);
    }
}

fn too_deep() -> Complaint {
    Complaint::new(
        Code::TooLarge,
        format!("the nesting is deeper than the {DEEPEST} levels that a pipeline may have"),
        "remove the brackets that nothing needs",
    )
}

impl Findings {
    /// A node as a key; a fault where it cannot be one.
    fn key(&self, node: Node, seen: &mut BTreeMap<String, usize>) -> Key {
        let text = match node.value {
            Value::Text(text) => text,
            Value::Refused => return Key::Refused,
            other => {
                let found = other.words();
                self.say(
                    node.span,
                    Code::WrongShape,
                    format!("a key is {found}, but must be a name"),
                    "write a name",
                );
                return Key::Refused;
            }
        };
        if text == "<<" {
            self.say(
                node.span,
                Code::NotSupported,
                "`<<` merges what is defined elsewhere, which a pipeline file does not allow",
                "write the keys themselves",
            );
            return Key::Refused;
        }
        if let Some(line) = seen.get(&text) {
            let name = shown(&text);
            self.say(
                node.span,
                Code::DuplicateName,
                format!("{name} is repeated: it is on line {line} already"),
                "remove one of them or give it another name",
            );
            return Key::Refused;
        }
        seen.insert(text.clone(), node.span.line);
        Key::Known(Marked::new(text, node.span))
    }
}
