//! The journals of a session in the order of time.

use stillpoint_recorder::{Session, times};
use stillpoint_samples::{Cause, Entry};

use crate::graph::Graph;

/// The entries of all operators, in an order in which each comes after all that it depends on.
pub struct Ordered<'s> {
    /// Place in time, operator, entry, and why it cannot be done again in its order, if it cannot.
    entries: Vec<(u64, usize, &'s Entry, Option<String>)>,
}

impl<'s> Ordered<'s> {
    /// Orders by time, then by place in the graph: a sample is consumed at a later time than it was made, or at the
    /// same time further down.
    pub fn new(session: &'s Session, graph: &Graph) -> Self {
        let mut entries = Vec::new();
        for (operator, node) in graph.operators.iter().enumerate() {
            let Some(journal) = session.journals().get(&node.name) else { continue };
            let mut before: Option<&Entry> = None;
            for (entry, (time, wrong)) in journal.iter().zip(times(journal)) {
                entries.push((time, operator, entry, gap(before, entry).or(wrong)));
                before = Some(entry);
            }
        }
        entries.sort_by_key(|(time, operator, entry, _)| {
            (*time, *operator, entry.header.incarnation, entry.header.sequence)
        });
        Self { entries }
    }

    /// The entries in order.
    pub fn entries(self) -> impl Iterator<Item = (usize, &'s Entry, Option<String>)> {
        self.timed().map(|(_, operator, entry, missing)| (operator, entry, missing))
    }

    /// The entries in order, each with its place in time.
    pub fn timed(self) -> impl Iterator<Item = (u64, usize, &'s Entry, Option<String>)> {
        self.entries.into_iter()
    }

    /// Session time between the first and the last entry, s.
    pub fn seconds(&self) -> f64 {
        let stamps = || self.entries.iter().map(|(time, ..)| *time);
        stamps().max().unwrap_or(0).saturating_sub(stamps().min().unwrap_or(0)) as f64 / 1e9
    }
}

/// What is missing between an entry and the one recorded before it.
fn gap(before: Option<&Entry>, entry: &Entry) -> Option<String> {
    let expected = match before {
        Some(b) if b.header.incarnation == entry.header.incarnation => b.header.sequence + 1,
        _ => 0,
    };
    let missing = entry.header.sequence.saturating_sub(expected);
    if missing > 0 {
        return Some(format!("{missing} journal entries before it were not recorded"));
    }
    (expected == 0 && entry.cause() != Some(Cause::Start))
        .then(|| "the incarnation's first entry is missing".to_string())
}
