//! Variables of the environment in paths: `${NAME}`, `${NAME:-default}`, and `~/` for the home folder.
//!
//! They are replaced when a pipeline is checked to run. A session keeps the pipeline with their values, so that a replay
//! needs none of them.

use std::collections::BTreeMap;

use super::faults::{Code, Complaint, Findings};
use super::includes::{FileText, based};
use super::near::{nearest, shown};
use super::paths;
use super::source::Span;
use super::tree::{Node, Value};
use crate::operator::{Files, Registry};

/// How a variable begins.
const BEGIN: &str = "${";
/// What stands between a variable and its default.
const ELSE: &str = ":-";
/// The variable that `~` stands for.
const HOME: &str = "HOME";

/// What was replaced in the paths of a pipeline.
#[derive(Default)]
pub struct Replaced {
    /// The path in the place of each text that named a variable.
    pub paths: BTreeMap<Span, String>,
    /// The variables that were used, with the values that they had.
    pub used: BTreeMap<String, String>,
}

/// Replaces the variables in the paths of a pipeline, and lets those of included files start at the folder of the pipeline
/// file. A variable in another place is a fault.
pub fn expand(
    root: &mut Node,
    texts: &[FileText],
    variables: &BTreeMap<String, String>,
    replaced: &mut Replaced,
    registry: &Registry,
    files: &dyn Files,
    findings: &Findings,
) {
    let is_whole = paths::each(root, registry, files, &mut |node| {
        path(node, variables, replaced, findings);
        let folder = texts.get(node.span.source).map_or("", FileText::folder);
        if let Value::Text(text) = &mut node.value
            && !folder.is_empty()
            && !text.starts_with('/')
        {
            *text = based(folder, text);
            replaced.paths.insert(node.span, text.clone());
        }
    });
    if is_whole {
        elsewhere(root, findings);
    }
}

/// Replaces the variables in one path.
pub fn path(
    node: &mut Node,
    variables: &BTreeMap<String, String>,
    replaced: &mut Replaced,
    findings: &Findings,
) {
    let Value::Text(text) = &node.value else { return };
    match expanded(text, variables, &mut replaced.used) {
        Ok(path) if path == *text => {}
        Ok(path) => {
            replaced.paths.insert(node.span, path.clone());
            node.value = Value::Text(path);
        }
        Err(complaint) => {
            findings.add(node.span, complaint);
            node.value = Value::Refused;
        }
    }
}

/// A path with the values of its variables; notes those that it used.
fn expanded(
    text: &str,
    variables: &BTreeMap<String, String>,
    used: &mut BTreeMap<String, String>,
) -> Result<String, Complaint> {
    let mut value_of = |name: &str, default: Option<&str>| match variables.get(name).filter(|v| !v.is_empty())
    {
        Some(value) if value.contains(BEGIN) => Err(Complaint::new(
            Code::Variable,
            format!("the value of the variable `{name}` names a variable itself: {}", shown(value)),
            format!("set `{name}` to a path"),
        )),
        Some(value) => {
            used.insert(name.to_owned(), value.clone());
            Ok(value.clone())
        }
        None => default.map(str::to_owned).ok_or_else(|| unset(name, variables)),
    };
    let mut path = String::new();
    let mut rest = text;
    if let Some(behind) = text.strip_prefix("~/") {
        path = format!("{}/", value_of(HOME, None)?.trim_end_matches('/'));
        rest = behind;
    }
    while let Some((before, behind)) = rest.split_once(BEGIN) {
        let (inside, after) = behind.split_once('}').ok_or_else(|| {
            Complaint::new(
                Code::Variable,
                format!("{} has no `}}` behind `${{`", shown(text)),
                "write `${NAME}`",
            )
        })?;
        let (name, default) = match inside.split_once(ELSE) {
            Some((name, default)) => (name, Some(default)),
            None => (inside, None),
        };
        if !is_variable(name) {
            return Err(Complaint::new(
                Code::Variable,
                format!("{} is not the name of a variable: a name has letters, digits and `_`", shown(name)),
                "write `${NAME}`, or `${NAME:-default}`",
            ));
        }
        path.push_str(before);
        path.push_str(&value_of(name, default)?);
        rest = after;
    }
    path.push_str(rest);
    Ok(path)
}

fn is_variable(name: &str) -> bool {
    let starts = name.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_');
    starts && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_')
}

fn unset(name: &str, variables: &BTreeMap<String, String>) -> Complaint {
    let near = nearest(name, variables.keys().map(String::as_str)).filter(|near| near.len() > 2);
    let meant = near.map(|near| format!("; did you mean `${{{near}}}`?")).unwrap_or_default();
    let state = if variables.contains_key(name) { "is empty" } else { "is not set" };
    Complaint::new(
        Code::Variable,
        format!("the variable `{name}` of the environment {state}"),
        format!(
            "set it before the command, `{name}=/path stillpoint ...`, or write `${{{name}:-/path}}`{meant}"
        ),
    )
}

/// Finds variables in values that are not paths.
fn elsewhere(node: &mut Node, findings: &Findings) {
    match &mut node.value {
        Value::Text(text) if text.split_once(BEGIN).is_some_and(|(_, behind)| behind.contains('}')) => {
            findings.say(
                node.span,
                Code::Variable,
                format!("{} names a variable of the environment, but is not a path", shown(text)),
                "write the value itself, or give it by `--set`",
            );
            node.value = Value::Refused;
        }
        Value::List(items) => items.iter_mut().for_each(|item| elsewhere(item, findings)),
        Value::Map(entries) => entries.iter_mut().for_each(|e| elsewhere(&mut e.value, findings)),
        _ => {}
    }
}
