//! Parameters that change while an operator runs: which do, and a change that is checked as the config is.

use std::cell::RefCell;

use super::verify::Everything;
use super::{CheckedParams, ParamField, ParamReader, ParamType};
use crate::config::faults::Findings;
use crate::config::near::{listed, nearest, shown};
use crate::config::source::{Marked, Span};
use crate::config::tree::{Entry, Node, Value};
use crate::config::yaml;
use crate::stage::Stage;

/// Source number of a value that came while the operator ran.
const LIVE: usize = usize::MAX - 1;

/// Why a parameter is not changed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SetError {
    /// The kind has no such parameter.
    #[error("{kind} has no parameter {name}; {help}")]
    Unknown {
        /// Name of the kind.
        kind: &'static str,
        /// The name, quoted.
        name: String,
        /// The nearest name, or all.
        help: String,
    },
    /// The parameter holds for a whole run.
    #[error("`{path}` of {kind} is not live: it holds for a whole run; {live}")]
    NotLive {
        /// Name of the kind.
        kind: &'static str,
        /// The parameter.
        path: String,
        /// The live parameters of the kind.
        live: String,
    },
    /// It has parts, of which each is changed alone.
    #[error("`{path}` has parts: change one of them ({parts})")]
    Group {
        /// The parameter.
        path: String,
        /// Its parts.
        parts: String,
    },
    /// The value cannot be read, is out of its range, or does not go together with the others.
    #[error("{0}")]
    Value(String),
}

/// Whether a kind with these fields has live parameters.
pub const fn has_live(fields: &[ParamField]) -> bool {
    let mut at = 0;
    while at < fields.len() {
        if fields[at].is_live {
            return true;
        }
        if let ParamType::Group(nested) = fields[at].ty
            && has_live(nested)
        {
            return true;
        }
        at += 1;
    }
    false
}

/// The live parameters of these fields, by their paths.
pub fn live_paths(fields: &'static [ParamField]) -> Vec<String> {
    let mut paths = Vec::new();
    collect(fields, "", false, &mut paths);
    paths
}

fn collect(fields: &'static [ParamField], before: &str, inherited: bool, paths: &mut Vec<String>) {
    for field in fields {
        let path = format!("{before}{}", field.name);
        let is_live = inherited || field.is_live;
        match field.ty {
            ParamType::Group(nested) => collect(nested, &format!("{path}."), is_live, paths),
            _ if is_live => paths.push(path),
            _ => {}
        }
    }
}

/// The field at a path such as `limits.position`, and whether it is live.
pub fn find(stage: &Stage, path: &str) -> Result<(&'static ParamField, bool), SetError> {
    let (mut fields, mut is_live, mut found) = (stage.fields, false, None);
    for step in path.split('.') {
        let Some(field) = fields.iter().find(|f| f.name == step) else {
            let names = fields.iter().map(|f| f.name);
            let help = match nearest(step, names.clone()) {
                Some(near) => format!("did you mean `{near}`?"),
                None => listed(names, "parameters"),
            };
            return Err(SetError::Unknown { kind: stage.kind.name, name: shown(step), help });
        };
        is_live |= field.is_live;
        found = Some(field);
        fields = match field.ty {
            ParamType::Group(nested) => nested,
            _ => &[],
        };
    }
    let unknown =
        || SetError::Unknown { kind: stage.kind.name, name: shown(path), help: "name one".to_owned() };
    found.map(|field| (field, is_live)).ok_or_else(unknown)
}

/// The parameters of an operator with one live parameter changed. The value is read as in the config, with its unit and
/// its range.
///
/// # Errors
/// See [`SetError`]. Parameters that do not go together are those of [`Operator::validate`](crate::Operator::validate).
pub fn changed(
    stage: &Stage,
    current: &CheckedParams,
    path: &str,
    value: &str,
) -> Result<CheckedParams, SetError> {
    let (field, is_live) = find(stage, path)?;
    if let ParamType::Group(nested) = field.ty {
        let parts = nested.iter().map(|f| f.name).collect::<Vec<_>>().join(", ");
        return Err(SetError::Group { path: path.to_owned(), parts });
    }
    if !is_live {
        let paths = live_paths(stage.fields);
        let live = if paths.is_empty() {
            "no parameter of this kind is live".to_owned()
        } else {
            format!("live are {}", paths.join(", "))
        };
        return Err(SetError::NotLive { kind: stage.kind.name, path: path.to_owned(), live });
    }
    let findings = Findings::default();
    let node = yaml::parse(value, LIVE, 0, &findings);
    let mut given = current.given.to_vec();
    if let Some(node) = node.filter(|node| !matches!(node.value, Value::Nothing)) {
        put(&mut given, path, node);
    } else if findings.is_empty() {
        return Err(SetError::Value(format!("no value for `{path}` (allowed: {})", allowed(field))));
    }
    let read = match findings.is_empty() {
        true => {
            let named = RefCell::default();
            let place = Span { source: LIVE, ..Span::default() };
            (stage.read)(
                stage,
                &mut ParamReader::new(&given, stage.kind.name, place, &findings, &Everything, &named),
            )
        }
        false => None,
    };
    match (read, findings.into_faults(Default::default()).list().first()) {
        (Some(params), None) => match (stage.validate)(&params) {
            Ok(()) => Ok(params),
            Err(conflict) => Err(SetError::Value(conflict.reason)),
        },
        (_, Some(fault)) => Err(SetError::Value(format!("{}; {}", fault.message, fault.help))),
        (None, None) => Err(SetError::Value(format!("{} cannot be read", shown(value)))),
    }
}

/// What a parameter may be, in words.
fn allowed(field: &ParamField) -> String {
    field.range().unwrap_or_else(|| match field.choices() {
        [] => format!("a value such as {}", super::reader::example(field)),
        choices => choices.join(", "),
    })
}

fn put(entries: &mut Vec<Entry>, path: &str, node: Node) {
    let (first, rest) = path.split_once('.').map_or((path, None), |(first, rest)| (first, Some(rest)));
    let key = Marked::new(first.to_owned(), node.span);
    let number = entries.iter().position(|e| e.key.value == first);
    match rest {
        None => {
            let entry = Entry { key, value: node };
            match number {
                Some(number) => entries[number] = entry,
                None => entries.push(entry),
            }
        }
        Some(rest) => {
            let number = number.unwrap_or_else(|| {
                let value = Node::new(Value::Map(Vec::new()), node.span);
                entries.push(Entry { key, value });
                entries.len() - 1
            });
            let group = &mut entries[number].value;
            if !matches!(group.value, Value::Map(_)) {
                group.value = Value::Map(Vec::new());
            }
            if let Value::Map(inner) = &mut group.value {
                put(inner, rest, node);
            }
        }
    }
}

/// Where the value of a parameter came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// The config does not give it.
    Default,
    /// The pipeline's file.
    File,
    /// An argument of the command line.
    Argument,
    /// A change while the operator runs.
    Live,
}

impl Origin {
    /// The word that people read.
    pub fn word(self) -> &'static str {
        match self {
            Self::Default => "default",
            Self::File => "file",
            Self::Argument => "--set",
            Self::Live => "live",
        }
    }
}

/// Where the value at a path came from; of a list or a group, the newest part counts.
pub fn origin(params: &CheckedParams, path: &str) -> Origin {
    let mut entries: &[Entry] = &params.given;
    let mut steps = path.split('.').peekable();
    while let Some(step) = steps.next() {
        let Some(entry) = entries.iter().find(|e| e.key.value == step) else { return Origin::Default };
        if steps.peek().is_none() {
            return match newest(&entry.value) {
                0 => Origin::File,
                LIVE => Origin::Live,
                _ => Origin::Argument,
            };
        }
        entries = match &entry.value.value {
            Value::Map(inner) => inner,
            _ => return Origin::Default,
        };
    }
    Origin::Default
}

fn newest(node: &Node) -> usize {
    let inner = match &node.value {
        Value::List(items) => items.iter().map(newest).max(),
        Value::Map(entries) => entries.iter().map(|e| newest(&e.value)).max(),
        _ => None,
    };
    inner.unwrap_or(0).max(node.span.source)
}
