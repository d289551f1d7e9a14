//! `include`: operators, frames, links and other sections out of other files.
//!
//! What included files say stands before what the file says that includes them. A name that two files give is a fault, and of
//! a key with one value the last counts. `with` gives values for the places that a file names under `parameters`.

use std::collections::BTreeMap;
use std::path::Path;

use super::document;
use super::faults::{Code, Findings};
use super::fields::check_name;
use super::near::{shown, suggestion};
use super::source::{MOST_BYTES, Source, Span};
use super::tree::{Entry, Keys, Node, TEXT, Value};
use super::variables::{self, Replaced};
use super::{sets, yaml};
use crate::operator::Files;

/// The key that names the files to include.
pub const INCLUDE: &str = "include";
/// The key of the places that a file which includes this one may give values for.
pub const PARAMETERS: &str = "parameters";
/// Keys of an included file.
pub const KEYS: &[&str] = &["file", "with"];

/// Keys with one value: that of the last file counts.
const ONE_VALUE: &[&str] = &["stillpoint", "name", "seed", "record", "ros2"];
/// Most files of a pipeline.
const MOST_FILES: usize = 32;
/// What `include` may be.
const EXPECTED: &str = "the path of a file, `{ file: PATH, with: { PARAMETER: VALUE } }`, or a list of these";

/// A file of a pipeline.
pub struct FileText {
    /// Its path from the folder of the pipeline file.
    pub path: String,
    /// Its name in messages, and its text.
    pub source: Source,
    /// Where it is included; of the pipeline file, nothing.
    at: Span,
}

impl FileText {
    /// The pipeline file.
    pub fn own(file_name: &str, text: &str) -> Self {
        let path =
            Path::new(file_name).file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
        Self { path, source: Source::file(file_name, text), at: Span::default() }
    }

    /// The folder that its paths start at, from that of the pipeline file.
    pub fn folder(&self) -> &str {
        self.path.rsplit_once('/').map_or("", |(folder, _)| folder)
    }
}

/// A path that starts at a folder.
pub fn based(folder: &str, path: &str) -> String {
    if folder.is_empty() || path.starts_with('/') { path.to_owned() } else { format!("{folder}/{path}") }
}

/// The places that a file names, by the names of its parameters.
type Parameters = BTreeMap<String, Vec<(String, Span)>>;

/// Reads included files.
pub struct Includes<'a> {
    /// The files of the pipeline, the first of which is the pipeline file.
    texts: &'a mut Vec<FileText>,
    /// Where files are read.
    files: &'a dyn Files,
    /// Variables of the environment.
    variables: &'a BTreeMap<String, String>,
    /// The variables that were used.
    replaced: &'a mut Replaced,
    /// The faults.
    findings: &'a Findings,
    /// Whether every file could be read: else names are missing that are no fault.
    pub is_whole: bool,
    /// Nodes of values that `with` gave.
    given: usize,
}

impl<'a> Includes<'a> {
    /// For a pipeline file, which is the first of `texts`.
    pub fn new(
        texts: &'a mut Vec<FileText>,
        files: &'a dyn Files,
        variables: &'a BTreeMap<String, String>,
        replaced: &'a mut Replaced,
        findings: &'a Findings,
    ) -> Self {
        Self { texts, files, variables, replaced, findings, is_whole: true, given: 0 }
    }

    /// Puts what files hold into the place of `include` in the tree of a pipeline file.
    pub fn expand(&mut self, root: &mut Node) {
        self.file(root, &mut vec![0]);
    }

    /// The same for the last file of a chain of files that include each other. Gives its parameters.
    fn file(&mut self, root: &mut Node, chain: &mut Vec<usize>) -> Parameters {
        let Value::Map(entries) = &mut root.value else { return Parameters::new() };
        let mut take = |key: &str| {
            let at = entries.iter().position(|e| e.key.value == key)?;
            Some(entries.remove(at))
        };
        let (include, parameters) = (take(INCLUDE), take(PARAMETERS));
        if let Some(include) = include {
            let own = std::mem::take(entries);
            for item in items(&include.value) {
                let entries_of_file = self.included(item, chain);
                self.is_whole &= entries_of_file.is_some();
                for entry in entries_of_file.unwrap_or_default() {
                    self.merge(entries, entry);
                }
            }
            own.into_iter().for_each(|entry| self.merge(entries, entry));
            entries.sort_by_key(|e| document::KEYS.iter().position(|key| *key == e.key.value));
        }
        parameters.map(|entry| self.parameters(&entry, root)).unwrap_or_default()
    }

    /// The entries of an included file; none where it cannot be read.
    fn included(&mut self, item: &Node, chain: &mut Vec<usize>) -> Option<Vec<Entry>> {
        let (mut file, with) = match &item.value {
            Value::Map(entries) => {
                let keys = Keys::of(entries, KEYS, "an included file", self.findings);
                match keys.get("file") {
                    Some(file) => (file.value.clone(), keys.get("with").map(|e| e.value.clone())),
                    None => {
                        item.refuse("`include`", EXPECTED, self.findings);
                        return None;
                    }
                }
            }
            _ => (item.clone(), None),
        };
        file.scalar("`include`", EXPECTED, self.findings)?;
        variables::path(&mut file, self.variables, self.replaced, self.findings);
        let Value::Text(path) = &file.value else { return None };
        let includer = chain.last().copied().unwrap_or(0);
        let path = plain(&based(self.texts[includer].folder(), path));
        let text = self.read(&path, &file, chain)?;
        let number = self.texts.len();
        let folder = Path::new(&self.texts[0].source.name).parent().unwrap_or(Path::new(""));
        let source = Source::file(&folder.join(&path).display().to_string(), &text);
        self.texts.push(FileText { path, source, at: file.span });
        let Some(mut root) = yaml::parse(&text, number, 0, self.findings) else {
            if text.trim().is_empty() {
                self.findings.say(
                    file.span,
                    Code::WrongShape,
                    "the included file is empty",
                    "remove it, or write `stillpoint: 1` and sections",
                );
            }
            return None;
        };
        root.map("the file", "a mapping with the keys of a pipeline", self.findings)?;
        let version = root.get("stillpoint").cloned();
        document::version(version.as_ref(), "an included file", root.span.first(1), self.findings);
        chain.push(number);
        let parameters = self.file(&mut root, chain);
        chain.pop();
        if let Some(with) = with {
            self.give(&with, &parameters, number, &mut root);
        }
        match root.value {
            Value::Map(entries) => Some(entries),
            _ => None,
        }
    }

    /// The text of a file that is included at a place.
    fn read(&self, path: &str, at: &Node, chain: &[usize]) -> Option<String> {
        let refuse = |message: String, help: &str| {
            self.findings.say(at.span, Code::Include, message, help);
            None
        };
        let named = |number: &usize| self.texts[*number].source.name.as_str();
        if let Some(before) = self.texts.iter().position(|file| plain(&file.path) == path) {
            if let Some(from) = chain.iter().position(|number| *number == before) {
                let ring = chain[from..].iter().chain([&before]).map(named).collect::<Vec<_>>().join(" -> ");
                return refuse(format!("the file includes itself: {ring}"), "remove this include");
            }
            let place = self.place(self.texts[before].at);
            return refuse(
                format!("{} is included at {place} already", shown(named(&before))),
                "remove one of the two: a pipeline includes a file once",
            );
        }
        if self.texts.len() >= MOST_FILES {
            return refuse(format!("the pipeline has more than {MOST_FILES} files"), "join some of them");
        }
        let bytes = match self.files.list(path) {
            Ok(list) if list == [path] => self.files.read(path),
            Ok(_) => return refuse(format!("{} is not one file", shown(path)), "name one pipeline file"),
            Err(reason) => Err(reason),
        };
        match bytes {
            Err(reason) => refuse(
                format!("{} cannot be included: {reason}", shown(path)),
                "write its path from the folder of the file that includes it",
            ),
            Ok(bytes) if bytes.len() > MOST_BYTES => refuse(
                format!(
                    "{} has more than the {MOST_BYTES} bytes that a file of a pipeline may have",
                    shown(path)
                ),
                "split it; is it a pipeline file?",
            ),
            Ok(bytes) => match String::from_utf8(bytes) {
                Ok(text) => Some(text),
                Err(_) => refuse(format!("{} is not UTF-8 text", shown(path)), "save it as UTF-8 text"),
            },
        }
    }

    /// Adds an entry of a further file to what the files before it say.
    fn merge(&self, all: &mut Vec<Entry>, new: Entry) {
        let Some(old) = all.iter_mut().find(|e| e.key.value == new.key.value) else {
            all.push(new);
            return;
        };
        if ONE_VALUE.contains(&new.key.value.as_str()) {
            *old = new;
            return;
        }
        match (&mut old.value.value, new.value.value) {
            (Value::Map(olds), Value::Map(news)) => {
                for entry in news {
                    match olds.iter().find(|e| e.key.value == entry.key.value) {
                        Some(other) => self.findings.say(
                            entry.key.span,
                            Code::DuplicateName,
                            format!(
                                "`{}` has {} already at {}",
                                new.key.value,
                                shown(&entry.key.value),
                                self.place(other.key.span)
                            ),
                            "give one of them another name, or change the values of the included one by `with`",
                        ),
                        None => olds.push(entry),
                    }
                }
            }
            (Value::List(olds), Value::List(news)) => olds.extend(news),
            (_, Value::Nothing) => {}
            // A section of another form is a fault, so that form stays.
            (old_value, value) => {
                let is_list = new.key.value == "contracts";
                let fits = matches!(
                    (&*old_value, is_list),
                    (Value::Nothing, _) | (Value::Map(_), false) | (Value::List(_), true)
                );
                if fits {
                    *old = Entry { value: Node { value, ..new.value }, key: new.key };
                }
            }
        }
    }

    /// The parameters of a file: each of its places is that of an operator or of a section.
    fn parameters(&self, entry: &Entry, root: &Node) -> Parameters {
        let expected = "a mapping from names to places such as `face.leaf`";
        let mut all = Parameters::new();
        for parameter in entry.value.map("`parameters`", expected, self.findings).unwrap_or_default() {
            check_name(&parameter.key, "a parameter", self.findings);
            let mut places = Vec::new();
            for node in items(&parameter.value) {
                let Some(place) = node.scalar(&shown(&parameter.key.value), expected, self.findings) else {
                    continue;
                };
                if sets::is_place(root, place, node.span, self.findings) {
                    places.push((place.to_owned(), node.span));
                }
            }
            all.insert(parameter.key.value.clone(), places);
        }
        all
    }

    /// Puts the values of `with` at the places of the parameters of a file.
    fn give(&mut self, with: &Node, parameters: &Parameters, number: usize, root: &mut Node) {
        let expected = "a mapping from parameters of the included file to values";
        for entry in with.map("`with`", expected, self.findings).unwrap_or_default() {
            let Some(places) = parameters.get(&entry.key.value) else {
                self.findings.say(
                    entry.key.span,
                    Code::Include,
                    format!(
                        "{} has no parameter {}",
                        shown(&self.texts[number].source.name),
                        shown(&entry.key.value)
                    ),
                    suggestion(
                        &entry.key.value,
                        parameters.keys().map(String::as_str),
                        "parameters",
                        self.findings,
                    ),
                );
                continue;
            };
            if matches!(entry.value.value, Value::Nothing) {
                entry.value.refuse(&shown(&entry.key.value), TEXT, self.findings);
                continue;
            }
            // A value for many places must not become more than a pipeline may be.
            self.given += entry.value.count() * places.len();
            if self.given > MOST_BYTES {
                self.findings.say(
                    entry.value.span,
                    Code::TooLarge,
                    "`with` gives more values than a pipeline may have",
                    "give fewer, or for fewer places",
                );
                return;
            }
            for (place, span) in places {
                sets::put(root, place, entry.value.clone(), *span, self.findings);
            }
        }
    }

    fn place(&self, span: Span) -> String {
        let name = self.texts.get(span.source).map_or("", |file| file.source.name.as_str());
        format!("{name}:{}:{}", span.line, span.column)
    }
}

/// The items of a list, or the one value that stands in its place.
fn items(node: &Node) -> &[Node] {
    match &node.value {
        Value::List(items) => items,
        _ => std::slice::from_ref(node),
    }
}

/// A path without `.` and without a folder that the next part leaves.
fn plain(path: &str) -> String {
    let mut parts: Vec<&str> = Vec::new();
    for part in path.split('/') {
        match part {
            "." => {}
            ".." if parts.last().is_some_and(|last| !matches!(*last, ".." | "")) => _ = parts.pop(),
            _ => parts.push(part),
        }
    }
    parts.join("/")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_is_named_one_way() {
        for (path, expected) in [
            ("a.yaml", "a.yaml"),
            ("./a.yaml", "a.yaml"),
            ("parts/../a.yaml", "a.yaml"),
            ("../a.yaml", "../a.yaml"),
            ("../../b/./a.yaml", "../../b/a.yaml"),
            ("/x/../a.yaml", "/a.yaml"),
        ] {
            assert_eq!(plain(path), expected);
        }
    }
}
