//! The consistent cut: what of a session whose recorder died can be believed together.
//!
//! Topics reach the file independently, so at a cut one is ahead of another. An entry is published before the outputs
//! of its activation, so an output without its entry is only ahead of it, and so is an entry whose inputs are missing.
//! Both are dropped until nothing refers beyond what is there.

use std::collections::BTreeMap;

use stillpoint_samples::{Entry, JournalRef, RefKind};

use crate::journal::outputs;
use crate::session::{Session, Topic};
use crate::topic::Role;

/// Where each topic ends: samples at or beyond (incarnation, sequence) are dropped. Topics not named keep all.
pub(crate) type Limits = BTreeMap<String, (u32, u64)>;

/// The journal of one operator, and how much of it is kept.
struct Producer<'a> {
    topic: &'a Topic,
    inputs: &'a [String],
    outputs: &'a [String],
    entries: &'a [Entry],
    retained: usize,
}

impl Producer<'_> {
    /// Behind the last output on `port` that a kept entry names, in the last incarnation that is kept.
    fn end(&self, port: usize) -> (u32, u64) {
        let retained = &self.entries[..self.retained];
        let Some(incarnation) = retained.last().map(|e| e.header.incarnation) else { return (0, 0) };
        let last = retained.iter().rev().take_while(|e| e.header.incarnation == incarnation);
        (incarnation, last.flat_map(|e| outputs(e, port)).map(end).max().unwrap_or(0))
    }
}

/// Behind the last sample that a reference names.
fn end(r: &JournalRef) -> u64 {
    r.first.saturating_add(u64::from(r.count))
}

/// The limits of a session that did not end in order.
pub(crate) fn consistent_cut(session: &Session) -> Limits {
    let none: &[Entry] = &[];
    let mut producers: Vec<Producer<'_>> = Vec::new();
    for topic in session.topics() {
        if let Role::Journal { inputs, outputs } = &topic.role {
            let entries = session.journals().get(&topic.operator).map_or(none, Vec::as_slice);
            producers.push(Producer { topic, inputs, outputs, entries, retained: entries.len() });
        }
    }
    let (recorded, lost) = (recorded_ends(session), lost_ends(session));
    loop {
        let available = available(session, &producers, &recorded, &lost);
        let mut shorter = false;
        for p in &mut producers {
            let inputs = p.inputs;
            let beyond = |e: &Entry| {
                let consumed = e.refs.iter().filter(|r| r.count > 0 && r.kind != RefKind::Output as u32);
                consumed.into_iter().any(|r| {
                    let limit = inputs.get(r.port as usize).and_then(|topic| available.get(topic.as_str()));
                    // An older incarnation is not at the tail: what is missing of it was lost, not cut.
                    limit.is_some_and(|l| r.incarnation >= l.0 && (r.incarnation, end(r)) > *l)
                })
            };
            if let Some(first) = p.entries[..p.retained].iter().position(beyond) {
                p.retained = first;
                shorter = true;
            }
        }
        if !shorter {
            break;
        }
    }
    let mut limits = Limits::new();
    for p in &producers {
        for (port, name) in p.outputs.iter().enumerate() {
            limits.insert(name.clone(), p.end(port));
        }
        let last = p.entries[..p.retained].last();
        let end = last.map_or((0, 0), |e| (e.header.incarnation, e.header.sequence.saturating_add(1)));
        limits.insert(p.topic.name.clone(), end);
    }
    limits
}

/// Behind the last sample of each topic that is recorded. Topics without any are left out.
fn recorded_ends(session: &Session) -> BTreeMap<&str, (u32, u64)> {
    let mut ends = BTreeMap::new();
    for (number, topic) in session.topics().iter().enumerate() {
        if let Some((incarnation, sequence)) = session.numbers(number).next_back() {
            ends.insert(topic.name.as_str(), (incarnation, sequence.saturating_add(1)));
        }
    }
    ends
}

/// Behind the last sample of each topic that is listed as lost: what was lost was not cut.
fn lost_ends(session: &Session) -> BTreeMap<&str, (u32, u64)> {
    let mut ends: BTreeMap<&str, (u32, u64)> = BTreeMap::new();
    for lost in session.lost() {
        let end = ends.entry(lost.topic.as_str()).or_default();
        *end = (*end).max((lost.incarnation, lost.first.saturating_add(lost.count)));
    }
    ends
}

/// Behind the last sample of each topic that replay can have: recorded, or computed again from a kept entry.
fn available<'a>(
    session: &'a Session,
    producers: &[Producer<'a>],
    recorded: &BTreeMap<&'a str, (u32, u64)>,
    lost: &BTreeMap<&'a str, (u32, u64)>,
) -> BTreeMap<&'a str, (u32, u64)> {
    let mut available = recorded.clone();
    for (name, end) in lost {
        let known = available.entry(name).or_default();
        *known = (*known).max(*end);
    }
    for p in producers {
        for (port, name) in p.outputs.iter().enumerate() {
            let journalled = p.end(port);
            let number = session.topic_number(name);
            let source = number.filter(|n| session.topics()[*n].role == Role::Source);
            let end = match source {
                // Replay cannot make it: it must be recorded too.
                Some(number) => {
                    let last = session.last_before(number, journalled);
                    let lost = lost.get(name.as_str()).copied().unwrap_or_default();
                    last.map_or((0, 0), |(i, s)| (i, s.saturating_add(1))).max(lost).min(journalled)
                }
                None => journalled,
            };
            available.insert(name, end);
        }
    }
    available
}
