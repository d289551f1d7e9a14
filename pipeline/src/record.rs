//! The record of an activation: what a schedule decides, before it happens.

use stillpoint_samples::{Cause, Entry, JournalRef, RefKind};

/// A schedule's decision on one activation. It names samples, and does not carry them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Record {
    /// Time of the activation, ns.
    pub time: u64,
    /// When it was due, ns.
    pub nominal: u64,
    /// Number of the timer's tick.
    pub tick: u64,
    /// What causes it.
    pub cause: Cause,
    /// The input that causes it.
    pub port: usize,
    /// The samples consumed, one reference per input that brings one.
    pub inputs: Vec<JournalRef>,
}

impl Record {
    /// The record behind a journal entry; `None` where the entry marks no activation.
    pub fn of(entry: &Entry) -> Option<Self> {
        let cause = entry.cause()?;
        if matches!(cause, Cause::Start | Cause::End) {
            return None;
        }
        Some(Self {
            time: entry.header.stamp,
            nominal: entry.body.nominal,
            tick: entry.body.tick,
            cause,
            port: entry.body.port as usize,
            inputs: entry.refs.iter().filter(|r| r.kind != RefKind::Output as u32).copied().collect(),
        })
    }
}
