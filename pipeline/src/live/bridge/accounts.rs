//! The counts of the bridge, and the lines of the ledger that follow from them.
//!
//! A topic that leaves has a line from its operator to the bridge, and one per edge or topic of ROS 2 for the network. An
//! edge that arrives, or what arrives from ROS 2, has a line from the network to the operator that takes it.

use serde::{Deserialize, Serialize};

use super::network::{SentCounts, TakenCounts};
use super::ros2::PublicationDef;
use crate::far_end;
use crate::graph::Graph;
use crate::hosts::BRIDGE;
use crate::ledger::{Ledger, LedgerLine, ShmAccount};

/// The counts of a topic that leaves.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LeftCounts {
    /// Number of its operator.
    pub operator: usize,
    /// Number of the output.
    pub port: usize,
    /// What the bridge took, by incarnation of the operator.
    pub taken: Vec<(u32, ShmAccount)>,
    /// By edge.
    pub edges: Vec<(String, SentCounts)>,
}

/// The counts of an edge that arrives.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ArrivedCounts {
    /// Number of the operator that takes its samples.
    pub operator: usize,
    /// The edge.
    pub edge: String,
    /// What came over the network.
    pub network: TakenCounts,
    /// Samples handed over in shared memory.
    pub landed: u64,
    /// Samples for which shared memory had no room.
    pub pool_exhausted: u64,
}

/// The counts of one life of the bridge.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct BridgeReport {
    /// Topics that leave.
    pub leaves: Vec<LeftCounts>,
    /// Edges that arrive.
    pub arrives: Vec<ArrivedCounts>,
    /// These are the counts at its end in order. Those of a bridge that died are up to 100 ms old.
    pub is_last: bool,
}

/// The counts of all lives of the bridge of a run.
#[derive(Clone, Debug, Default)]
pub struct BridgeAccounts {
    lives: Vec<BridgeReport>,
}

impl BridgeAccounts {
    /// A life begins.
    pub fn begin(&mut self) {
        self.lives.push(BridgeReport::default());
    }

    /// Takes the newest counts of the life that goes on.
    pub fn enter(&mut self, report: BridgeReport) {
        if let Some(last) = self.lives.last_mut() {
            *last = report;
        }
    }

    /// The lines of the ledger.
    pub fn lines(&self, graph: &Graph, ledger: &mut Ledger) -> Vec<LedgerLine> {
        let mut lines = Vec::new();
        let mut left: Vec<(usize, usize)> =
            graph.leaves().map(|(operator, port, _)| (operator, port)).collect();
        left.extend(graph.publishes().map(|(operator, port, _)| (operator, port)));
        left.sort_unstable();
        left.dedup();
        for (operator, port) in left {
            let lives = self.lives.iter().map(|life| {
                let counts = life.leaves.iter().find(|l| (l.operator, l.port) == (operator, port));
                counts.map(|c| c.taken.as_slice()).unwrap_or_default()
            });
            lines.push(ledger.line_of_bridge(graph, (operator, port), BRIDGE, lives));
        }
        lines.extend(graph.leaves().map(|(operator, port, edge)| {
            self.leaving(graph, (operator, port), &edge, &format!("{BRIDGE}.{edge}"))
        }));
        lines.extend(graph.publishes().map(|(operator, port, publication)| {
            let PublicationDef { name, .. } = PublicationDef::of(publication);
            self.leaving(graph, (operator, port), &name, &name)
        }));
        lines.extend(graph.arrives().map(|operator| {
            let node = &graph.operators[operator];
            let (from, to) = (format!("{BRIDGE}.{}", node.name), &node.outputs[far_end::SAMPLE].topic);
            self.arriving(LedgerLine::of(&from, to), operator, ledger.total_sent(operator, far_end::SAMPLE))
        }));
        lines.extend(graph.subscribes().map(|operator| {
            let node = &graph.operators[operator];
            let from = node.subscriptions.first().map_or_else(String::new, |s| format!("ros2:{}", s.topic));
            // It sends one sample there for each message.
            let taken = ledger.total_sent(operator, node.outputs.len().saturating_sub(1));
            self.arriving(LedgerLine::of(&from, &node.name), operator, taken)
        }));
        lines
    }

    /// From the bridge over the network: samples count as received when the other host says so.
    fn leaving(
        &self,
        graph: &Graph,
        (operator, port): (usize, usize),
        edge: &str,
        consumer: &str,
    ) -> LedgerLine {
        let topic = &graph.operators[operator].outputs[port].topic;
        let mut line = LedgerLine::of(topic, consumer);
        for counts in
            self.lives.iter().flat_map(|l| &l.leaves).filter(|l| (l.operator, l.port) == (operator, port))
        {
            let taken: u64 = counts.taken.iter().map(|(_, account)| account.total).sum();
            let Some((_, sent)) = counts.edges.iter().find(|(name, _)| name == edge) else { continue };
            let arrived = sent.received + sent.refused;
            line.sent += sent.offered;
            line.received += sent.received;
            line.refused += sent.refused;
            line.overwritten += sent.replaced;
            line.unheard += sent.unheard;
            line.left += sent.waiting;
            line.lost += sent.put.saturating_sub(arrived);
            line.unexplained += taken.abs_diff(sent.offered) + arrived.saturating_sub(sent.put);
        }
        line
    }

    /// From the network to the operator: what left the other host since the bridge here was opened.
    fn arriving(&self, mut line: LedgerLine, operator: usize, taken: u64) -> LedgerLine {
        let mut arrived = 0;
        for counts in self.lives.iter().flat_map(|l| &l.arrives).filter(|a| a.operator == operator) {
            arrived += counts.network.received;
            line.refused += counts.network.refused;
            line.lost += counts.network.lost;
            line.pool_exhausted += counts.pool_exhausted;
        }
        line.received = taken;
        // What a bridge handed over after its last counts has arrived, too.
        let is_reported = self.lives.iter().all(|life| life.is_last);
        let arrived = if is_reported { arrived } else { arrived.max(line.received + line.pool_exhausted) };
        line.sent = arrived + line.refused + line.lost;
        line.overwritten = arrived.saturating_sub(line.received + line.pool_exhausted);
        line.unexplained = (line.received + line.pool_exhausted).saturating_sub(arrived);
        line
    }
}
