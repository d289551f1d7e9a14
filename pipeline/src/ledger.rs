//! The ledger: for every edge, sent = received + accounted loss, over crashes too.
//!
//! It is made of journal entries alone. Each states running totals, so that the last entry of an incarnation is enough,
//! and an entry survives the process that published it.

use std::collections::BTreeMap;

use serde::Serialize;
use stillpoint_samples::{Entry, JournalRef, RefKind};

use crate::graph::Graph;

/// The journal entries of a run, as far as the ledger needs them.
#[derive(Default)]
pub struct Ledger {
    /// By operator, output, incarnation: samples sent, and of those without memory.
    sent: BTreeMap<(usize, u32, u32), (u64, u64)>,
    /// By consumer, its incarnation, input, producer's incarnation: the last account.
    taken: BTreeMap<(usize, u32, u32, u32), JournalRef>,
    /// By operator and incarnation: number of the last entry, and entries missing before it.
    entries: BTreeMap<(usize, u32), (u64, u64)>,
}

/// The account of one edge.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct LedgerLine {
    /// The topic.
    pub topic: String,
    /// The consumer's input, `operator.input`.
    pub consumer: String,
    /// Samples that journal entries say were sent.
    pub sent: u64,
    /// Samples that the consumer took.
    pub received: u64,
    /// Of those: passed over by policy (superseded, or without partners).
    pub passed: u64,
    /// Pushed out of a full buffer by newer ones.
    pub overwritten: u64,
    /// Never sent, since the producer's memory was used up.
    pub pool_exhausted: u64,
    /// Lost while the consumer was down, between two of its incarnations.
    pub down: u64,
    /// Waiting when the consumer ended, or cut off by the end of the producer's incarnation.
    pub left: u64,
    /// What none of these explains: must be 0.
    pub unexplained: u64,
}

impl Ledger {
    /// Takes an entry of an operator. Entries of one incarnation come in order; some may be missing.
    pub fn enter(&mut self, operator: usize, entry: &Entry) {
        let incarnation = entry.header.incarnation;
        let number = entry.header.sequence;
        let (last, missing) = self.entries.entry((operator, incarnation)).or_insert((0, number));
        *missing += number.saturating_sub(*last + 1);
        *last = number.max(*last);
        for r in &entry.refs {
            match RefKind::from_number(r.kind) {
                Some(RefKind::Output) => {
                    self.sent.insert((operator, r.port, incarnation), (r.total, r.lost));
                }
                Some(RefKind::Fresh | RefKind::Held) if r.total > 0 => {
                    let key = (operator, incarnation, r.port, r.incarnation);
                    let slot = self.taken.entry(key).or_insert(*r);
                    let last = slot.first.max(r.first);
                    *slot = JournalRef { first: last, ..*r };
                }
                _ => {}
            }
        }
    }

    /// Journal entries that were not seen here, though their numbers show that they were published.
    pub fn missing_entries(&self) -> u64 {
        self.entries.values().map(|(_, missing)| missing).sum()
    }

    /// The account of every edge, in the order of the graph.
    pub fn lines(&self, graph: &Graph) -> Vec<LedgerLine> {
        let mut lines = Vec::new();
        for (consumer, node) in graph.operators.iter().enumerate() {
            for (port, input) in node.inputs.iter().enumerate() {
                let Some(edge) = input.edge else { continue };
                let mut line = LedgerLine {
                    topic: graph.operators[edge.operator].outputs[edge.output].topic.clone(),
                    consumer: format!("{}.{}", node.name, node.stage.kind.inputs[port].name),
                    sent: 0,
                    received: 0,
                    passed: 0,
                    overwritten: 0,
                    pool_exhausted: 0,
                    down: 0,
                    left: 0,
                    unexplained: 0,
                };
                let sent = self
                    .sent
                    .iter()
                    .filter(|((o, p, _), _)| (*o, *p as usize) == (edge.operator, edge.output));
                for ((_, _, incarnation), (total, pool_exhausted)) in sent {
                    self.balance(&mut line, consumer, port as u32, *incarnation, *total, *pool_exhausted);
                }
                lines.push(line);
            }
        }
        lines
    }

    /// Adds what one incarnation of the producer sent. `total` counts from sequence 0.
    fn balance(
        &self,
        line: &mut LedgerLine,
        consumer: usize,
        port: u32,
        incarnation: u32,
        total: u64,
        pool_exhausted: u64,
    ) {
        line.sent += total;
        // Numbers below this are accounted for.
        let mut next = 0;
        let accounts =
            self.taken.iter().filter(|((c, _, p, i), _)| (*c, *p, *i) == (consumer, port, incarnation));
        let (mut explained, mut gaps, mut twice) = (0, 0, 0);
        for ((_, life, _, _), r) in accounts {
            let span = r.total + r.lost;
            let first = (r.first + 1).saturating_sub(span);
            // What came before the first sample taken: the consumer, or this life of it, was not there yet.
            let before = first.saturating_sub(next);
            if next > 0 || *life > 0 {
                line.down += before;
            } else {
                gaps += before;
            }
            // A sample taken twice, or before its number, is explained by nothing.
            twice += next.saturating_sub(first);
            line.received += r.total;
            line.passed += r.passed;
            gaps += r.lost;
            explained += before + span;
            next = r.first + 1;
        }
        let left = total.saturating_sub(next);
        let unsent = pool_exhausted.min(gaps + left);
        line.pool_exhausted += unsent;
        let from_gaps = unsent.min(gaps);
        line.overwritten += gaps - from_gaps;
        line.left += left - (unsent - from_gaps);
        // Each incarnation by itself: what is wrong in one must not cancel what is wrong in another.
        line.unexplained += total.abs_diff(explained + left - twice) + twice;
    }
}

impl LedgerLine {
    /// Whether the account balances.
    pub fn balances(&self) -> bool {
        let accounted = self.received + self.overwritten + self.pool_exhausted + self.down + self.left;
        self.unexplained == 0 && accounted == self.sent
    }
}

#[cfg(test)]
mod tests;
