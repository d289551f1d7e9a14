//! The ledger: for every edge, sent = received + accounted loss, over crashes too.
//!
//! It is made of journal entries alone. Each states running totals, so that the last entry of an incarnation is enough,
//! and an entry survives the process that published it.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
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

/// What a bridge received from one incarnation of an operator through shared memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ShmAccount {
    /// Number of the last sample.
    pub last: u64,
    /// Samples taken.
    pub total: u64,
    /// Samples between them that newer ones pushed out.
    pub lost: u64,
}

impl ShmAccount {
    /// Takes the sample of this number.
    pub fn take(&mut self, number: u64) {
        if self.total > 0 {
            self.lost += number.saturating_sub(self.last + 1);
        }
        (self.last, self.total) = (number, self.total + 1);
    }
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
    /// Over the network: no host was there to take them.
    #[serde(skip_serializing_if = "is_zero")]
    pub unheard: u64,
    /// Over the network: the other host did not take them for valid.
    #[serde(skip_serializing_if = "is_zero")]
    pub refused: u64,
    /// Over the network: lost on the way, or under way at the end.
    #[serde(skip_serializing_if = "is_zero")]
    pub lost: u64,
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
                let name = format!("{}.{}", node.name, node.stage.kind.inputs[port].name);
                lines.push(self.line(graph, (edge.operator, edge.output), &name, (consumer, port as u32)));
            }
        }
        lines
    }

    /// The account between an output and one of its consumers.
    fn line(
        &self,
        graph: &Graph,
        (operator, output): (usize, usize),
        name: &str,
        (consumer, port): (usize, u32),
    ) -> LedgerLine {
        let mut line = LedgerLine::of(&graph.operators[operator].outputs[output].topic, name);
        let sent = self.sent.iter().filter(|((o, p, _), _)| (*o, *p as usize) == (operator, output));
        for ((_, _, incarnation), (total, pool_exhausted)) in sent {
            self.balance(&mut line, consumer, port, *incarnation, *total, *pool_exhausted);
        }
        line
    }

    /// The account between an output and the bridge, from what each life of the bridge took of each incarnation.
    pub(crate) fn line_of_bridge<'l>(
        &mut self,
        graph: &Graph,
        output: (usize, usize),
        name: &str,
        lives: impl Iterator<Item = &'l [(u32, ShmAccount)]>,
    ) -> LedgerLine {
        // It is no operator of the graph: each output has a number of its own behind those.
        let consumer = graph.operators.len() + output.0;
        let port = output.1 as u32;
        for (life, taken) in lives.enumerate() {
            for (incarnation, account) in taken.iter().filter(|(_, account)| account.total > 0) {
                let ShmAccount { last, total, lost } = *account;
                let taken = JournalRef { first: last, total, lost, ..JournalRef::default() };
                self.taken.insert((consumer, life as u32, port, *incarnation), taken);
            }
        }
        self.line(graph, output, name, (consumer, port))
    }

    /// Samples that an output sent, over all incarnations.
    pub(crate) fn total_sent(&self, operator: usize, output: usize) -> u64 {
        let of = self.sent.iter().filter(|((o, p, _), _)| (*o, *p as usize) == (operator, output));
        of.map(|(_, (total, without_memory))| total.saturating_sub(*without_memory)).sum()
    }

    /// Samples of an output that found no memory, over all incarnations.
    pub(crate) fn total_unsent(&self, operator: usize, output: usize) -> u64 {
        let of = self.sent.iter().filter(|((o, p, _), _)| (*o, *p as usize) == (operator, output));
        of.map(|(_, (_, without_memory))| without_memory).sum()
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

// serde asks for a reference.
#[allow(clippy::trivially_copy_pass_by_ref)]
fn is_zero(count: &u64) -> bool {
    *count == 0
}

impl LedgerLine {
    /// An account of nothing yet.
    pub(crate) fn of(topic: &str, consumer: &str) -> Self {
        Self {
            topic: topic.to_owned(),
            consumer: consumer.to_owned(),
            sent: 0,
            received: 0,
            passed: 0,
            overwritten: 0,
            pool_exhausted: 0,
            down: 0,
            left: 0,
            unheard: 0,
            refused: 0,
            lost: 0,
            unexplained: 0,
        }
    }

    /// Whether the account balances.
    pub fn balances(&self) -> bool {
        let over_the_network = self.unheard + self.refused + self.lost;
        let in_memory = self.received + self.overwritten + self.pool_exhausted + self.down + self.left;
        let accounted = in_memory + over_the_network;
        self.unexplained == 0 && accounted == self.sent
    }
}

#[cfg(test)]
mod tests;
