//! Where a session begins and ends on its time axis.

use stillpoint_recorder::Session;
use stillpoint_samples::{Cause, Entry};

use crate::graph::Graph;

/// Begin and end of the timers of a session, ns of session time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    /// When tick 0 of every timer was due.
    pub start: u64,
    /// No tick that was due from here on was taken.
    pub end: u64,
}

impl Span {
    /// The span of a session; `None` where its journals are empty.
    ///
    /// In session time every tick before the end is taken, so the end lies behind the last tick of each timer and no
    /// later than the next one of any. A live run skips ticks, and ends by level: its end is behind its last tick.
    pub fn of(session: &Session, graph: &Graph, is_directed: bool) -> Option<Self> {
        let mut starts: Vec<u64> = Vec::new();
        let mut ticks: Vec<(u64, u64)> = Vec::new();
        let mut last = None;
        for node in &graph.operators {
            let Some(journal) = session.journals().get(&node.name) else { continue };
            let ordinary = journal.iter().filter(|e| e.cause().is_some_and(|c| c != Cause::End));
            last = last.max(ordinary.map(|e| e.header.stamp).max());
            starts.extend(journal.first().map(|e| e.header.stamp));
            let Some(every) = node.every else { continue };
            let timed = |e: &&Entry| e.cause() == Some(Cause::Timer);
            for entry in journal.iter().filter(timed) {
                let since = entry.body.tick.checked_mul(every);
                starts.extend(since.and_then(|since| entry.body.nominal.checked_sub(since)));
            }
            ticks.extend(journal.iter().rfind(timed).map(|e| (e.body.nominal, every)));
        }
        let start = starts.into_iter().min()?;
        let least = match ticks.iter().map(|(nominal, _)| *nominal).max() {
            Some(nominal) => nominal.saturating_add(1),
            None => last.unwrap_or(start).saturating_add(1),
        };
        let next = ticks.iter().map(|(nominal, every)| nominal.saturating_add(*every)).min();
        let end = next.filter(|_| is_directed).map_or(least, |next| next.max(least));
        Some(Self { start, end })
    }

    /// From begin to end, ns.
    pub fn length(&self) -> u64 {
        self.end.saturating_sub(self.start)
    }
}
