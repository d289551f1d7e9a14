//! Reading parameters out of the marked tree, with every fault.

use std::cell::RefCell;

use serde_json::Value as Json;

use super::value::choices_help;
use super::{Names, ParamField, ParamType, ParamValue};
use crate::config::faults::{Code, Complaint, Findings};
use crate::config::near::{nearest, shown};
use crate::config::source::Span;
use crate::config::tree::{Entry, Keys, Node, TEXT, Value};
use crate::config::yaml;
use crate::files::Files;
use crate::pattern;

/// Source number of a default: it stands in no text that people see.
const DEFAULT: usize = usize::MAX;

/// Reads parameters out of a config.
pub struct ParamReader<'a> {
    entries: &'a [Entry],
    keys: Option<Keys<'a>>,
    /// What the parameters belong to, for messages.
    owner: &'a str,
    /// Where a missing parameter is reported.
    place: Span,
    findings: &'a Findings,
    files: &'a dyn Files,
    named: &'a RefCell<Vec<String>>,
    resolved: Json,
}

impl<'a> ParamReader<'a> {
    /// A reader of the entries of `params:`. Files that parameters name are added to `named`.
    pub fn new(
        entries: &'a [Entry],
        owner: &'a str,
        place: Span,
        findings: &'a Findings,
        files: &'a dyn Files,
        named: &'a RefCell<Vec<String>>,
    ) -> Self {
        Self { entries, keys: None, owner, place, findings, files, named, resolved: Json::Null }
    }

    /// The parameters as read, defaults filled in, in SI units.
    pub fn resolved(&self) -> Json {
        self.resolved.clone()
    }

    /// The parameters as the config gives them.
    pub fn given(&self) -> &'a [Entry] {
        self.entries
    }

    /// Where a missing parameter is reported.
    pub fn place(&self) -> Span {
        self.place
    }

    /// Where the files are that parameters name.
    pub fn files(&self) -> &'a dyn Files {
        self.files
    }

    /// Sorts the entries by the fields; an unknown one is a fault. To be called first.
    pub fn open(&mut self, fields: &'static [ParamField]) {
        let names: Vec<&'static str> = fields.iter().map(|f| f.name).collect();
        self.keys = Some(Keys::called("parameter", self.entries, &names, self.owner, self.findings));
    }

    /// Reads one field.
    pub fn field<T: ParamValue>(&self, field: &'static ParamField) -> Option<T> {
        match (self.keys.as_ref().and_then(|k| k.get(field.name)), field.default) {
            (Some(entry), _) => T::read(&entry.value, field, self),
            (None, Some(text)) => T::read(&default_node(text, T::TYPE, self.findings)?, field, self),
            (None, None) => T::absent(field, self),
        }
    }

    /// Reads a nested group of fields.
    pub fn group<T: super::Params>(&self, node: &Node, field: &ParamField) -> Option<T> {
        let entries = node.map(&shown(field.name), "a mapping", self.findings)?;
        self.nested(entries, field, node.span.first(1))
    }

    /// A nested group that the config does not give: all its fields have their defaults.
    pub fn absent_group<T: super::Params>(&self, field: &ParamField) -> Option<T> {
        if field.is_required() {
            self.missing(field);
            return None;
        }
        self.nested(&[], field, self.place)
    }

    fn nested<T: super::Params>(&self, entries: &[Entry], field: &ParamField, place: Span) -> Option<T> {
        let owner = format!("`{}` of {}", field.name, self.owner);
        T::read(&mut ParamReader::new(entries, &owner, place, self.findings, self.files, self.named))
    }

    /// Keeps what [`resolved`](Self::resolved) returns. To be called last.
    pub fn keep(&mut self, resolved: Json) {
        self.resolved = resolved;
    }

    /// Reads a text that must be one of `names`.
    pub fn choice<'n>(
        &self,
        node: &'n Node,
        field: &ParamField,
        names: &'static [&'static str],
    ) -> Option<&'n str> {
        let text = node.scalar(&shown(field.name), TEXT, self.findings)?;
        if names.contains(&text) {
            return Some(text);
        }
        let help = match nearest(text, names.iter().copied()) {
            Some(near) => format!("did you mean `{near}`?"),
            None => choices_help(names),
        };
        let message = format!("{} is not a choice", shown(text));
        self.complain(node, field, Complaint::new(Code::UnknownChoice, message, help));
        None
    }

    /// Faults of this reader.
    pub fn findings(&self) -> &Findings {
        self.findings
    }

    /// Adds a fault about the value of a field.
    pub fn complain(&self, node: &Node, field: &ParamField, complaint: Complaint) {
        let Complaint { code, message, help } = complaint;
        if node.span.source == DEFAULT {
            let message = format!("the default of `{}` cannot be read: {message}", field.name);
            self.findings.say(self.place, code, message, "report it: the operator is declared wrongly");
        } else {
            self.findings.say(node.span, code, format!("`{}`: {message}", field.name), help);
        }
    }

    /// Adds the fault that a field must be given.
    pub fn missing(&self, field: &ParamField) {
        let example = example(field);
        self.findings.say(
            self.place,
            Code::MissingParam,
            format!("{} needs the parameter `{}`", self.owner, field.name),
            format!("add `{}: {example}`", field.name),
        );
    }

    /// Adds a file that the operator reads though no parameter names it, such as its own source.
    pub fn reads(&self, name: &str) {
        let mut named = self.named.borrow_mut();
        if !named.iter().any(|known| known == name) {
            named.push(name.to_owned());
        }
    }

    /// Checks that a file is there, or files are, and keeps the name: that of a folder with the pattern of the files that
    /// are meant.
    pub(super) fn file(&self, node: &Node, field: &ParamField, name: &str) -> Option<String> {
        let alone = self.files.list(name);
        let is_file = alone.as_ref().is_ok_and(|list| *list == [name]);
        let inside = match field.names {
            Names::Files(all) if !is_file && !pattern::is_one(name) => Some(pattern::inside(name, all)),
            _ => None,
        };
        let (name, list) = match inside.map(|inside| (self.files.list(&inside), inside)) {
            Some((list, inside)) if list.is_ok() || alone.is_ok() => (inside, list),
            _ => (name.to_owned(), alone),
        };
        let wrong = match (list, field.names) {
            (Err(reason), _) => {
                Some((reason.to_string(), "write its path from the folder of this file, or put it there"))
            }
            (Ok(list), Names::File) if list != [name.as_str()] => {
                let found = if pattern::is_one(&name) { "a pattern" } else { "a folder" };
                Some((format!("it is {found}, but one file is expected"), "name one of its files"))
            }
            (Ok(list), _) if list.is_empty() => Some((
                "no file matches this pattern".into(),
                "put the files there, or write what their names have in common, with `*` for the rest",
            )),
            _ => None,
        };
        if let Some((reason, help)) = wrong {
            let message = format!("{} cannot be used: {reason}", shown(&name));
            self.complain(node, field, Complaint::new(Code::FileMissing, message, help));
            return None;
        }
        self.reads(&name);
        Some(name)
    }
}

/// A value that a config could give for a field, for help and reference.
pub(crate) fn example(field: &ParamField) -> String {
    example_of(field, field.ty)
}

fn example_of(field: &ParamField, ty: ParamType) -> String {
    let quantity = |plain: &str| match (field.min.or(field.max), crate::config::units::find(field.unit)) {
        // A bound is no value that anyone means.
        (Some(_), Some(_)) => format!("<{}>", field.unit),
        (Some(_), None) => "<number>".into(),
        (None, Some((dimension, _))) => {
            let unit = dimension.units.get(1).or(dimension.units.first()).map_or("", |u| u.symbol);
            format!("5 {unit}")
        }
        (None, None) => plain.to_owned(),
    };
    match ty {
        ParamType::Number => quantity("0.5"),
        ParamType::Integer { .. } => quantity("5"),
        ParamType::Switch => "true".into(),
        ParamType::Text => match (field.choices.first(), field.names) {
            (Some(choice), _) => (*choice).to_owned(),
            (None, Names::Nothing) => "text".into(),
            (None, _) => "path/to/file".into(),
        },
        ParamType::Choice(names) => names.first().copied().unwrap_or_default().to_owned(),
        ParamType::List { of, len } => {
            let item = example_of(field, *of);
            format!("[{}]", vec![item; len.unwrap_or(1).clamp(1, 6)].join(", "))
        }
        ParamType::Group(fields) => {
            let required: Vec<String> = fields
                .iter()
                .filter(|f| f.is_required())
                .map(|f| format!("{}: {}", f.name, example(f)))
                .collect();
            format!("{{ {} }}", required.join(", "))
        }
    }
}

fn default_node(text: &'static str, ty: ParamType, findings: &Findings) -> Option<Node> {
    let span = Span { source: DEFAULT, start: 0, end: 0, line: 1, column: 1 };
    match ty {
        ParamType::List { .. } | ParamType::Group(_) => {
            let mut node = yaml::parse(text, DEFAULT, 0, findings)?;
            mark(&mut node, span);
            Some(node)
        }
        _ => Some(Node::text(text, span)),
    }
}

/// Gives a tree one place.
fn mark(node: &mut Node, span: Span) {
    node.span = span;
    match &mut node.value {
        Value::List(items) => items.iter_mut().for_each(|n| mark(n, span)),
        Value::Map(entries) => entries.iter_mut().for_each(|e| mark(&mut e.value, span)),
        _ => {}
    }
}
