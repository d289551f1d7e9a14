//! Faults of a session: failed activations, restarts, lost and unreadable samples, and how the recording ended.

use std::collections::BTreeMap;

use serde::Serialize;
use stillpoint_samples::{Cause, Outcome};

use crate::ReportError;
use crate::facts::{ending, gaps_with};
use crate::numbers::{count, fixed};
use crate::page::{Block, Cell, Mood, Section, Table};
use crate::recording::Recording;
use crate::source::Source;
use crate::wiring::is_activation;

/// Rows of a table; more are counted.
const SHOWN: usize = 50;
/// Metadata record that ends a session.
const END: &str = "stillpoint.end";

/// The faults of a session.
#[derive(Serialize)]
pub struct Faults {
    /// Failed activations and restarts, in the order of time.
    pub events: Vec<Event>,
    /// Why it is not complete; empty where it is.
    pub gaps: Vec<String>,
    /// Samples that the recorder could not keep.
    pub lost: Vec<Lost>,
    /// Frames without a result, by topic and reason.
    pub refusals: Vec<Refused>,
    /// How the recording ended.
    pub ended: String,
    /// The facts that the end of the session states.
    pub end: BTreeMap<String, String>,
    /// Number of samples that cannot be read.
    pub unreadable: u64,
    /// The first reasons why samples cannot be read.
    pub unreadable_because: Vec<String>,
}

/// A failed activation, or the start of a new incarnation.
#[derive(Serialize)]
pub struct Event {
    /// When, s since the session began.
    pub at_s: f64,
    pub operator: String,
    pub incarnation: u32,
    /// Description of the event.
    pub what: String,
}

/// Samples that were not kept.
#[derive(Serialize)]
pub struct Lost {
    topic: String,
    incarnation: u32,
    first: u64,
    count: u64,
}

/// Frames without a result.
#[derive(Serialize)]
pub struct Refused {
    topic: String,
    reason: String,
    frames: u64,
    first_at_s: f64,
}

/// The faults of a recording.
pub fn of(from: &Source<'_>) -> Faults {
    let recording = &from.recording;
    let session = recording.session;
    let foreign = from.pipeline.as_ref().err().map(ToString::to_string);
    let gaps = gaps_with(session, foreign.as_deref());
    let ended = ending(session);
    let lost = session.lost().iter().map(|l| Lost {
        topic: l.topic.clone(),
        incarnation: l.incarnation,
        first: l.first,
        count: l.count,
    });
    let mut events = events(recording);
    events.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
    Faults {
        events,
        gaps,
        lost: lost.collect(),
        refusals: refusals(recording),
        ended,
        end: session.metadata().get(END).cloned().unwrap_or_default(),
        unreadable: recording.unreadable.1,
        unreadable_because: recording.unreadable.0.clone(),
    }
}

fn events(recording: &Recording<'_>) -> Vec<Event> {
    let mut events = Vec::new();
    for (operator, entries) in recording.session.journals() {
        let mut before: Option<u64> = None;
        for entry in entries {
            let what = match (entry.cause(), entry.outcome()) {
                (Some(Cause::Start), _) if entry.header.incarnation > 0 => {
                    let down = before.map_or(0, |b| entry.header.stamp.saturating_sub(b));
                    Some(format!("restarted, {:.1} ms after its last entry", down as f64 * 1e-6))
                }
                (_, Some(Outcome::Error)) if is_activation(entry) => Some("returned an error".to_owned()),
                (_, Some(Outcome::Panic)) if is_activation(entry) => Some("panicked".to_owned()),
                _ => None,
            };
            before = Some(entry.header.stamp);
            events.extend(what.map(|what| Event {
                at_s: recording.seconds(entry.header.stamp),
                operator: operator.clone(),
                incarnation: entry.header.incarnation,
                what,
            }));
        }
    }
    events
}

fn refusals(recording: &Recording<'_>) -> Vec<Refused> {
    let mut found: BTreeMap<(&str, &str), (u64, f64)> = BTreeMap::new();
    for r in recording.refusals.items() {
        let first = (0, recording.seconds(r.stamp));
        found.entry((&r.topic, &r.reason)).or_insert(first).0 += recording.refusals.stride();
    }
    let refused = found.into_iter().map(|((topic, reason), (frames, first_at_s))| Refused {
        topic: topic.to_owned(),
        reason: reason.to_owned(),
        frames,
        first_at_s,
    });
    refused.collect()
}

pub fn section(from: &Source<'_>) -> Result<Section, ReportError> {
    let faults = of(from);
    let mut section = Section::new("faults", "Faults, restarts and losses", &faults)?;
    let mut say = |block| section.blocks.push(block);
    say(Block::Text(format!("The recording ended {}.", faults.ended)));
    if faults.gaps.is_empty() {
        say(Block::Text("The session is complete: it holds everything that a replay needs.".into()));
    } else {
        let mut table = Table::new(shown("Why the session is not complete", faults.gaps.len()), &["gap"]);
        faults.gaps.iter().take(SHOWN).for_each(|g| table.row([Cell::State(Mood::Bad, g.clone())]));
        say(Block::Table(table));
    }
    if faults.unreadable > 0 {
        let first = faults.unreadable_because.join("; ");
        let n = count(faults.unreadable);
        say(Block::Warning(format!(
            "{n} samples cannot be read and are omitted from all sections. The first reason: {first}"
        )));
    }
    if faults.events.is_empty() {
        say(Block::Text("No activation failed, and no operator was restarted.".into()));
    } else {
        let caption = shown("Failed activations and restarts", faults.events.len());
        let mut table = Table::new(caption, &["time, s", "operator", "life", "what happened"]);
        for e in faults.events.iter().take(SHOWN) {
            table.row([
                Cell::number(fixed(e.at_s, 3)),
                Cell::text(&e.operator),
                Cell::number(e.incarnation.to_string()),
                Cell::State(Mood::Bad, e.what.clone()),
            ]);
        }
        say(Block::Table(table));
    }
    if !faults.refusals.is_empty() {
        let caption = shown("Frames without a result", faults.refusals.len());
        let mut table = Table::new(caption, &["topic", "reason", "frames", "first at, s"]);
        for r in faults.refusals.iter().take(SHOWN) {
            table.row([
                Cell::text(&r.topic),
                Cell::text(&r.reason),
                Cell::number(count(r.frames)),
                Cell::number(fixed(r.first_at_s, 3)),
            ]);
        }
        say(Block::Table(table));
    }
    if !faults.lost.is_empty() {
        let caption = shown("Samples that the recorder could not keep", faults.lost.len());
        let mut table = Table::new(caption, &["topic", "life", "from number", "samples"]);
        for l in faults.lost.iter().take(SHOWN) {
            table.row([
                Cell::text(&l.topic),
                Cell::number(l.incarnation.to_string()),
                Cell::number(l.first.to_string()),
                Cell::number(count(l.count)),
            ]);
        }
        say(Block::Table(table));
    }
    let facts = faults.end.iter().filter(|(name, _)| !name.starts_with("gap.") && *name != "realtime_ns");
    let facts: Vec<String> =
        facts.map(|(name, value)| format!("{} {value}", name.trim_start_matches("fact."))).collect();
    if !facts.is_empty() {
        say(Block::Text(format!("Facts at the end of the session: {}.", facts.join(", "))));
    }
    Ok(section)
}

fn shown(what: &str, rows: usize) -> String {
    match rows.checked_sub(SHOWN) {
        None | Some(0) => what.to_owned(),
        Some(more) => format!("{what}: the first {SHOWN}; --json has {more} more"),
    }
}
