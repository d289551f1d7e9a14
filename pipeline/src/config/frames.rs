//! The section `frames`: which frame is placed where in which.

use std::collections::{BTreeMap, BTreeSet};

use super::faults::{Code, Findings};
use super::fields::{check_name, missing};
use super::near::shown;
use super::quantity;
use super::source::{Marked, Span};
use super::tree::{Entry, Keys, Node};
use crate::frames::{Frame, Frames, Rigid};

/// Keys of a frame.
pub const KEYS: &[&str] = &["parent", "at", "rotation", "measured", "residual"];

/// Reads the section.
pub fn read(node: &Node, findings: &Findings) -> Frames {
    let mut frames = Frames::default();
    let mut places = BTreeMap::new();
    for entry in node.map("`frames`", "a mapping from names to frames", findings).unwrap_or_default() {
        check_name(&entry.key, "a frame", findings);
        if let Some((frame, parent)) = frame(entry, findings) {
            places.insert(entry.key.value.clone(), parent);
            frames.placed.insert(entry.key.value.clone(), frame);
        }
    }
    circles(&frames, &places, findings);
    frames
}

fn frame(entry: &Entry, findings: &Findings) -> Option<(Frame, Span)> {
    let name = shown(&entry.key.value);
    let entries = entry.value.map(&name, "{ parent: couch, at: [0 mm, 0 mm, 0 mm] }", findings)?;
    let keys = Keys::of(entries, KEYS, "a frame", findings);
    let parent = match keys.get("parent") {
        Some(e) => e.value.scalar("`parent`", "the name of a frame", findings).map(|text| {
            let parent = Marked::new(text.to_owned(), e.value.span);
            check_name(&parent, "a frame", findings);
            parent
        }),
        None => {
            missing("a frame", "parent", "couch", entry.key.span, findings);
            None
        }
    };
    let at = match keys.get("at") {
        Some(e) => triple(e, "m", "three lengths", findings),
        None => {
            missing("a frame", "at", "[0 mm, 0 mm, 0 mm]", entry.key.span, findings);
            None
        }
    };
    let rotation = match keys.get("rotation") {
        Some(e) => triple(e, "rad", "three angles", findings),
        None => Some([0.0; 3]),
    };
    let measured = keys.get("measured").and_then(|e| date(e, findings));
    let residual = keys.get("residual").and_then(|e| length(e, findings));
    // What could not be read was said: a frame without it is still one, and whoever names it makes no mistake.
    let parent = parent.unwrap_or_else(|| Marked::new("couch".to_owned(), entry.key.span));
    let parent_from_frame = Rigid::from_angles(at.unwrap_or_default(), rotation.unwrap_or_default());
    Some((Frame { parent: parent.value, parent_from_frame, measured, residual }, parent.span))
}

fn triple(entry: &Entry, unit: &str, expected: &str, findings: &Findings) -> Option<[f64; 3]> {
    let key = &entry.key.value;
    let expected = format!("a list of {expected}");
    let items = entry.value.list(&shown(key), &expected, findings)?;
    if items.len() != 3 {
        findings.say(
            entry.value.span,
            Code::WrongShape,
            format!("`{key}` has {} items, but must be {expected}", items.len()),
            format!("write {expected}"),
        );
    }
    let read: Vec<Option<f64>> = items
        .iter()
        .map(|item| {
            let text = item.scalar(&shown(key), &expected, findings)?;
            quantity::si(text, unit).map_err(|c| findings.add(item.span, c.about(key))).ok()
        })
        .collect();
    read.into_iter().collect::<Option<Vec<f64>>>()?.try_into().ok()
}

fn length(entry: &Entry, findings: &Findings) -> Option<f64> {
    let text = entry.value.scalar("`residual`", "a length", findings)?;
    let value =
        quantity::si(text, "m").map_err(|c| findings.add(entry.value.span, c.about("residual"))).ok()?;
    if value < 0.0 {
        findings.say(
            entry.value.span,
            Code::OutOfRange,
            format!("the residual {} is negative", shown(text)),
            "write a length of at least 0 mm",
        );
        return None;
    }
    Some(value)
}

fn date(entry: &Entry, findings: &Findings) -> Option<String> {
    let text = entry.value.scalar("`measured`", "a date", findings)?;
    let parts: Vec<Option<u32>> = text
        .split('-')
        .zip([4, 2, 2])
        .map(|(p, n)| p.parse().ok().filter(|_| p.len() == n && p.bytes().all(|b| b.is_ascii_digit())))
        .collect();
    let is_date = text.len() == 10
        && match parts.as_slice() {
            [Some(year), Some(month), Some(day)] => (1..=days(*year, *month)).contains(day),
            _ => false,
        };
    if !is_date {
        findings.say(
            entry.value.span,
            Code::WrongShape,
            format!("{} is not a date", shown(text)),
            "write year, month and day: `2026-11-21`",
        );
        return None;
    }
    Some(text.to_owned())
}

/// The days of a month; none where there is no such month.
fn days(year: u32, month: u32) -> u32 {
    let is_leap = year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400));
    match month {
        2 => 28 + u32::from(is_leap),
        4 | 6 | 9 | 11 => 30,
        1..=12 => 31,
        _ => 0,
    }
}

/// Frames of a circle that a message names.
const MOST_NAMED: usize = 8;

/// Frames whose parents run in a circle hang on nothing.
fn circles(frames: &Frames, places: &BTreeMap<String, Span>, findings: &Findings) {
    let mut settled: BTreeSet<&str> = BTreeSet::new();
    for start in frames.placed.keys() {
        let mut path: Vec<&str> = Vec::new();
        let mut on_path: BTreeSet<&str> = BTreeSet::new();
        let mut at = start.as_str();
        while !settled.contains(at) && on_path.insert(at) {
            path.push(at);
            match frames.placed.get(at) {
                Some(frame) => at = &frame.parent,
                None => break,
            }
        }
        if !settled.contains(at)
            && frames.placed.contains_key(at)
            && let Some(from) = path.iter().position(|n| *n == at)
        {
            let circle = &path[from..];
            let mut names: Vec<String> = circle.iter().take(MOST_NAMED).map(|n| format!("`{n}`")).collect();
            if circle.len() > MOST_NAMED {
                names.push("…".into());
            }
            names.push(format!("`{at}`"));
            let span = path.last().and_then(|last| places.get(*last)).copied().unwrap_or_default();
            findings.say(
                span,
                Code::FrameCycle,
                format!("the frames {} hang on each other and on nothing else", names.join(" in ")),
                "give one of them a parent outside the circle",
            );
        }
        settled.extend(path);
    }
}
