//! Values that several sections have: names, times, counts, words; and the fault of a missing key.

use super::faults::{Code, Findings};
use super::near::{LONGEST_NAME, as_name, is_name, nearest, shown};
use super::quantity;
use super::source::{Marked, Span};
use super::tree::{Entry, Node};

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
    let expected = format!("a whole number from {least} to {greatest}");
    let text = entry.value.scalar(&key, &expected, findings)?;
    let value =
        quantity::whole(text).map_err(|c| findings.add(entry.value.span, c.about(&entry.key.value))).ok()?;
    if let Some(value) = u32::try_from(value).ok().filter(|v| (least..=greatest).contains(v)) {
        return Some(value);
    }
    let nearest = if value < i128::from(least) { least } else { greatest };
    findings.say(
        entry.value.span,
        Code::OutOfRange,
        format!("{key} is {}, but must be {expected}", shown(text)),
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
