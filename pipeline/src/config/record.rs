//! The section `record`: what a session keeps besides the journal.

use super::faults::{Code, Findings};
use super::fields::missing;
use super::inputs::{Topic, topic};
use super::near::nearest;
use super::near::shown;
use super::source::Marked;
use super::tree::{Keys, Node, Value};

/// Keys of the section.
pub const KEYS: &[&str] = &["topics"];

/// What is recorded, as it was written.
#[derive(Default)]
pub enum Parsed {
    /// The outputs of sources.
    #[default]
    Sources,
    /// Every topic.
    All,
    /// The outputs of sources and these.
    Topics(Vec<Marked<Topic>>),
}

/// Reads the section.
pub fn read(node: &Node, findings: &Findings) -> Option<Parsed> {
    if let Value::List(items) = &node.value {
        return bare(node, items, findings);
    }
    let entries = node.map("`record`", "{ topics: sources }", findings)?;
    let keys = Keys::of(entries, KEYS, "`record`", findings);
    let Some(entry) = keys.get("topics") else {
        missing("`record`", "topics", "sources", node.span.first(1), findings);
        return None;
    };
    match &entry.value.value {
        Value::Text(text) => match text.as_str() {
            "sources" => Some(Parsed::Sources),
            "all" => Some(Parsed::All),
            other => {
                let help = match nearest(other, ["sources", "all"]) {
                    Some(near) => format!("did you mean `{near}`?"),
                    None => "write `sources`, `all` or a list of topics".into(),
                };
                findings.say(
                    entry.value.span,
                    Code::UnknownChoice,
                    format!("{} does not say which topics are recorded", shown(other)),
                    help,
                );
                None
            }
        },
        _ => {
            let items = entry.value.list("`topics`", "`sources`, `all` or a list of topics", findings)?;
            Some(Parsed::Topics(items.iter().filter_map(|i| topic(i, findings)).collect()))
        }
    }
}

/// A list without its key. Its topics are still read, so that their faults come to light in the same pass.
fn bare(node: &Node, items: &[Node], findings: &Findings) -> Option<Parsed> {
    let names: Vec<&str> = items
        .iter()
        .filter_map(|item| match &item.value {
            Value::Text(text) => Some(text.as_str()),
            _ => None,
        })
        .collect();
    let help = match names.len() == items.len() && !items.is_empty() {
        true => format!("write `record: {{ topics: [{}] }}`", names.join(", ")),
        false => "write `record: { topics: [OPERATOR.OUTPUT] }`".to_owned(),
    };
    let message = "`record` is a list, but must be a mapping with the key `topics`";
    findings.say(node.span, Code::WrongShape, message, help);
    Some(Parsed::Topics(items.iter().filter_map(|item| topic(item, findings)).collect()))
}
