//! A parsed pipeline: the sections of the file as typed values with their places. Nothing is looked up yet.

use super::faults::{Code, Findings};
use super::near::{LONGEST_NAME, as_name, is_name, nearest, shown};
use super::operators::{self, ParsedOperator};
use super::processes::{self, ParsedProcess};
use super::source::{Marked, Span};
use super::tree::{Entry, Keys, Node};
use super::{frames, links, quantity, record};
use crate::frames::Frames;

/// The version of the format.
pub const VERSION: i128 = 1;
/// Keys of the file.
pub const KEYS: &[&str] =
    &["stillpoint", "name", "seed", "frames", "operators", "links", "processes", "record"];

/// A parsed pipeline. What had a fault is left out.
pub struct Document<'t> {
    /// Name of the pipeline.
    pub name: String,
    /// Seed of all random numbers.
    pub seed: u64,
    /// The frames.
    pub frames: Frames,
    /// The operators, in the order of the file.
    pub operators: Vec<ParsedOperator<'t>>,
    /// Where the links stand.
    pub links: Option<Span>,
    /// The processes, in the order of the file.
    pub processes: Vec<ParsedProcess>,
    /// What is recorded.
    pub record: record::Parsed,
}

/// Reads the sections of a file. `None` where the file is no mapping.
pub fn read<'t>(root: &'t Node, findings: &Findings) -> Option<Document<'t>> {
    let entries = root.map("the file", "a mapping with the keys of a pipeline", findings)?;
    let keys = Keys::of(entries, KEYS, "a pipeline", findings);
    let top = root.span.first(1);
    version(&keys, top, findings);
    let name = name(&keys, top, findings);
    let seed = keys.get("seed").and_then(|e| seed(&e.value, findings)).unwrap_or(1);
    let frames = keys.get("frames").map(|e| frames::read(&e.value, findings)).unwrap_or_default();
    let mut operators = match keys.get("operators") {
        Some(entry) => operators::read(entry, findings),
        None => {
            missing("a pipeline", "operators", "{ rig: { use: ... } }", top, findings);
            Vec::new()
        }
    };
    let links = keys.get("links").map(|entry| {
        links::read(&entry.value, &mut operators, findings);
        entry.value.span
    });
    let processes = keys.get("processes").map(|e| processes::read(&e.value, findings)).unwrap_or_default();
    let record = keys.get("record").and_then(|e| record::read(&e.value, findings)).unwrap_or_default();
    Some(Document { name, seed, frames, operators, links, processes, record })
}

fn version(keys: &Keys<'_>, top: Span, findings: &Findings) {
    let Some(entry) = keys.get("stillpoint") else {
        return missing("a pipeline", "stillpoint", "1", top, findings);
    };
    let Some(text) = entry.value.scalar("`stillpoint`", "the version of the format", findings) else {
        return;
    };
    if quantity::whole(text).ok() != Some(VERSION) {
        findings.say(
            entry.value.span,
            Code::WrongVersion,
            format!("{} is no version that this build reads", shown(text)),
            format!("write `stillpoint: {VERSION}`"),
        );
    }
}

fn name(keys: &Keys<'_>, top: Span, findings: &Findings) -> String {
    let Some(entry) = keys.get("name") else {
        missing("a pipeline", "name", "head-3dof", top, findings);
        return String::new();
    };
    let Some(text) = entry.value.scalar("`name`", "the pipeline's name", findings) else {
        return String::new();
    };
    if !is_name(&text.replace('-', "_")) {
        let help = as_name(text).map(|n| format!("write `{}`", n.replace('_', "-")));
        findings.say(
            entry.value.span,
            Code::BadName,
            format!(
                "{} cannot name a pipeline: a name is lower-case letters, digits, `-` and `_`",
                shown(text)
            ),
            help.unwrap_or_else(|| format!("write a name of at most {LONGEST_NAME} characters")),
        );
    }
    text.to_owned()
}

/// Reads the seed.
pub fn seed(node: &Node, findings: &Findings) -> Option<u64> {
    let text = node.scalar("`seed`", "a whole number", findings)?;
    let seed = quantity::whole(text).ok().and_then(|s| u64::try_from(s).ok());
    if seed.is_none() {
        findings.say(
            node.span,
            Code::NotANumber,
            format!("the seed {} is not a whole number from 0 to {}", shown(text), u64::MAX),
            "write a whole number, for example `seed: 7`",
        );
    }
    seed
}

/// Adds the fault that a key is missing.
pub fn missing(place: &str, key: &str, example: &str, span: Span, findings: &Findings) {
    findings.say(
        span,
        Code::MissingKey,
        format!("{place} needs the key `{key}`"),
        format!("add `{key}: {example}`"),
    );
}

/// Checks the name of an operator, a process or a frame.
pub fn check_name(key: &Marked<String>, what: &str, findings: &Findings) {
    let name = &key.value;
    if is_name(name) {
        return;
    }
    let reason = if name.len() > LONGEST_NAME && is_name(&name[..LONGEST_NAME.min(floor(name))]) {
        format!("it has {} characters, more than {LONGEST_NAME}", name.len())
    } else {
        "a name starts with a lower-case letter and goes on with lower-case letters, digits and `_`".into()
    };
    let help = match as_name(name) {
        Some(better) => format!("write `{better}`"),
        None => format!("write {what} such as `camera_2`"),
    };
    findings.say(key.span, Code::BadName, format!("{} cannot name {what}: {reason}", shown(name)), help);
}

fn floor(text: &str) -> usize {
    (0..=LONGEST_NAME.min(text.len())).rev().find(|i| text.is_char_boundary(*i)).unwrap_or(0)
}

/// Reads a time in nanoseconds.
pub fn time(entry: &Entry, findings: &Findings) -> Option<Marked<u64>> {
    let key = &entry.key.value;
    let text = entry.value.scalar(&shown(key), "a time", findings)?;
    match quantity::nanoseconds(text) {
        Ok(value) => Some(Marked::new(value, entry.value.span)),
        Err(complaint) => {
            findings.add(entry.value.span, complaint.about(key));
            None
        }
    }
}

/// Reads a time that is not zero.
pub fn period(entry: &Entry, findings: &Findings) -> Option<Marked<u64>> {
    let time = time(entry, findings)?;
    if time.value > 0 {
        return Some(time);
    }
    findings.say(
        time.span,
        Code::OutOfRange,
        format!("`{}` must be longer than 0 s", entry.key.value),
        "write a time, for example `10 ms`, or remove the key",
    );
    None
}

/// Reads a whole number within limits.
pub fn count(entry: &Entry, least: u32, greatest: u32, findings: &Findings) -> Option<u32> {
    let key = shown(&entry.key.value);
    let due = format!("a whole number from {least} to {greatest}");
    let text = entry.value.scalar(&key, &due, findings)?;
    let value =
        quantity::whole(text).map_err(|c| findings.add(entry.value.span, c.about(&entry.key.value))).ok()?;
    if let Some(value) = u32::try_from(value).ok().filter(|v| (least..=greatest).contains(v)) {
        return Some(value);
    }
    let nearest = if value < i128::from(least) { least } else { greatest };
    findings.say(
        entry.value.span,
        Code::OutOfRange,
        format!("{key} is {}, but must be {due}", shown(text)),
        format!("the nearest allowed value is `{nearest}`"),
    );
    None
}

/// Adds the fault that a text is none of some words.
pub fn no_choice(node: &Node, text: &str, what: &str, words: &[&str], findings: &Findings) {
    let help = match nearest(text, words.iter().copied()) {
        Some(near) => format!("did you mean `{near}`?"),
        None => {
            let quoted: Vec<String> = words.iter().map(|w| format!("`{w}`")).collect();
            format!("write {}", quantity::or(&quoted.iter().map(String::as_str).collect::<Vec<_>>()))
        }
    };
    findings.say(node.span, Code::UnknownChoice, format!("{} is not {what}", shown(text)), help);
}
