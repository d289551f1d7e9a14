//! Minimum cut of a graph with two terminals, by Dinic's blocking flows.
//!
//! Capacities are whole numbers, so the cut is exact and the same on every machine. Libraries for this build a graph
//! anew for each cut; this one keeps its buffers from frame to frame.

use std::collections::VecDeque;

/// Which side of the cut a node belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lean {
    /// The source's, whatever it costs.
    Source,
    /// The sink's, whatever it costs.
    Sink,
    /// What it costs to leave it to the sink, positive, or to the source, negative.
    Cost(i32),
}

/// One direction of an edge; its other direction is the arc with the last bit flipped.
#[derive(Debug, Clone, Copy)]
struct Arc {
    to: u32,
    next: u32,
    rest: u32,
}

const NONE: u32 = u32::MAX;

/// A graph with its buffers; after the first frames of a size it allocates nothing.
#[derive(Debug, Clone, Default)]
pub struct MinCut {
    /// First arc of each node; the two terminals stand behind the nodes.
    first: Vec<u32>,
    /// The terminal that a node is one with, or the node itself.
    stands_for: Vec<u32>,
    arcs: Vec<Arc>,
    level: Vec<u32>,
    current: Vec<u32>,
    queue: VecDeque<u32>,
    path: Vec<u32>,
}

impl MinCut {
    /// A graph without nodes.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Starts a graph of `nodes` nodes without edges.
    pub fn start(&mut self, nodes: usize) {
        self.first.clear();
        self.first.resize(nodes + 2, NONE);
        self.arcs.clear();
        self.stands_for.clear();
        self.stands_for.extend(0..nodes as u32);
    }

    fn source(&self) -> u32 {
        self.first.len() as u32 - 2
    }

    fn sink(&self) -> u32 {
        self.first.len() as u32 - 1
    }

    fn arc(&mut self, from: u32, to: u32, rest: u32) {
        let next = self.first[from as usize];
        self.first[from as usize] = self.arcs.len() as u32;
        self.arcs.push(Arc { to, next, rest });
    }

    /// Says which side a node belongs to. Comes before the node's edges.
    pub fn lean(&mut self, node: u32, lean: Lean) {
        let (source, sink) = (self.source(), self.sink());
        match lean {
            Lean::Source => self.stands_for[node as usize] = source,
            Lean::Sink => self.stands_for[node as usize] = sink,
            Lean::Cost(cost) if cost > 0 => self.join(source, node, cost.unsigned_abs()),
            Lean::Cost(cost) if cost < 0 => self.join(node, sink, cost.unsigned_abs()),
            Lean::Cost(_) => {}
        }
    }

    /// Joins two nodes: to part them costs `capacity`.
    pub fn join(&mut self, a: u32, b: u32, capacity: u32) {
        let [a, b] = [a, b].map(|node| self.stands_for.get(node as usize).copied().unwrap_or(node));
        // What joins a terminal to itself is never cut.
        if a != b {
            self.arc(a, b, capacity);
            self.arc(b, a, capacity);
        }
    }

    /// Cuts the graph where it is cheapest, and says what that costs. Of equal cuts, the one nearest to the source.
    pub fn cut(&mut self) -> u64 {
        let mut flow = 0;
        while self.find_levels() {
            self.current.clear();
            self.current.extend_from_slice(&self.first);
            while let Some(pushed) = self.augment() {
                flow += u64::from(pushed);
            }
        }
        flow
    }

    /// Whether a node is on the source's side of the last cut.
    #[must_use]
    pub fn with_source(&self, node: u32) -> bool {
        let node = self.stands_for.get(node as usize);
        node.and_then(|&node| self.level.get(node as usize)).is_some_and(|&level| level != NONE)
    }

    /// Numbers all nodes by their distance from the source over arcs that are not full.
    fn find_levels(&mut self) -> bool {
        self.level.clear();
        self.level.resize(self.first.len(), NONE);
        let source = self.source();
        self.level[source as usize] = 0;
        self.queue.clear();
        self.queue.push_back(source);
        while let Some(node) = self.queue.pop_front() {
            let mut at = self.first[node as usize];
            while at != NONE {
                let arc = self.arcs[at as usize];
                if arc.rest > 0 && self.level[arc.to as usize] == NONE {
                    self.level[arc.to as usize] = self.level[node as usize] + 1;
                    self.queue.push_back(arc.to);
                }
                at = arc.next;
            }
        }
        self.level[self.sink() as usize] != NONE
    }

    /// Pushes flow along one shortest path; `None` where there is no more.
    fn augment(&mut self) -> Option<u32> {
        let (source, sink) = (self.source(), self.sink());
        self.path.clear();
        let mut node = source;
        while node != sink {
            let at = self.current[node as usize];
            if at == NONE {
                // A dead end: no path leads through it any more.
                let back = self.path.pop()?;
                node = self.arcs[back as usize ^ 1].to;
                self.current[node as usize] = self.arcs[back as usize].next;
                continue;
            }
            let arc = self.arcs[at as usize];
            if arc.rest > 0 && self.level[arc.to as usize] == self.level[node as usize] + 1 {
                self.path.push(at);
                node = arc.to;
            } else {
                self.current[node as usize] = arc.next;
            }
        }
        let pushed = self.path.iter().map(|&at| self.arcs[at as usize].rest).min()?;
        for &at in &self.path {
            self.arcs[at as usize].rest -= pushed;
            let back = &mut self.arcs[at as usize ^ 1].rest;
            *back = back.saturating_add(pushed);
        }
        Some(pushed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn any_lean() -> impl Strategy<Value = Lean> {
        prop_oneof![1 => Just(Lean::Source), 1 => Just(Lean::Sink), 6 => (-20..20_i32).prop_map(Lean::Cost)]
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn no_other_cut_is_cheaper(
            leans in prop::collection::vec(any_lean(), 1..9),
            edges in prop::collection::vec((0..9_u32, 0..9_u32, 0..20_u32), 0..20),
        ) {
            let nodes = leans.len() as u32;
            let edges: Vec<_> = edges.into_iter().filter(|&(a, b, _)| a != b && a < nodes && b < nodes).collect();
            let cost = |with_source: &dyn Fn(u32) -> bool| -> u64 {
                let leaning = (0..nodes).map(|n| match (with_source(n), leans[n as usize]) {
                    (false, Lean::Source) | (true, Lean::Sink) => 1_000_000,
                    (false, Lean::Cost(lean)) if lean > 0 => lean as u64,
                    (true, Lean::Cost(lean)) if lean < 0 => -lean as u64,
                    _ => 0,
                });
                let parted = edges.iter().filter(|&&(a, b, _)| with_source(a) != with_source(b));
                leaning.sum::<u64>() + parted.map(|e| u64::from(e.2)).sum::<u64>()
            };
            let mut graph = MinCut::new();
            // A graph of before leaves nothing.
            graph.start(3);
            graph.lean(0, Lean::Cost(9));
            graph.lean(1, Lean::Cost(-9));
            graph.lean(2, Lean::Sink);
            graph.join(0, 1, 7);
            graph.join(2, 1, 7);
            graph.cut();
            graph.start(nodes as usize);
            for (node, &lean) in leans.iter().enumerate() {
                graph.lean(node as u32, lean);
            }
            for &(a, b, capacity) in &edges {
                graph.join(a, b, capacity);
            }
            let found = graph.cut();
            let least = (0..1_u32 << nodes).map(|set| cost(&|n| set >> n & 1 == 1)).min().unwrap();
            prop_assert_eq!(found, least);
            prop_assert_eq!(cost(&|n| graph.with_source(n)), least);
        }
    }
}
