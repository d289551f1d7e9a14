//! A graph with capacities, and what can still flow through it.

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

/// One direction of an edge.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Arc {
    pub to: u32,
    /// What can still flow along it.
    pub rest: u32,
    pub twin: u32,
}

/// More than all edges can carry.
const UNLIMITED: i64 = 1 << 48;

/// Nodes and the edges between them, with their buffers.
#[derive(Debug, Clone, Default)]
pub(super) struct Graph {
    /// For each node what can still flow from the source to it, positive, or from it to the sink, negative.
    pub rest: Vec<i64>,
    edges: Vec<(u32, u32, u32)>,
    /// Where each node's arcs start; one more at the end.
    starts: Vec<u32>,
    pub arcs: Vec<Arc>,
}

impl Graph {
    /// Starts a graph of `nodes` nodes without edges.
    pub fn start(&mut self, nodes: usize) {
        self.rest.clear();
        self.rest.resize(nodes, 0);
        self.edges.clear();
    }

    pub fn lean(&mut self, node: u32, lean: Lean) {
        self.rest[node as usize] = match lean {
            Lean::Source => UNLIMITED,
            Lean::Sink => -UNLIMITED,
            Lean::Cost(cost) => i64::from(cost),
        };
    }

    pub fn join(&mut self, a: u32, b: u32, capacity: impl FnOnce() -> u32) {
        let [at_a, at_b] = [a, b].map(|node| self.rest[node as usize]);
        // What cannot be on two sides is never cut.
        if a != b && !(at_a.abs() == UNLIMITED && at_a == at_b) {
            self.edges.push((a, b, capacity()));
        }
    }

    /// The numbers of a node's arcs.
    pub fn arcs_of(&self, node: u32) -> std::ops::Range<u32> {
        self.starts[node as usize]..self.starts[node as usize + 1]
    }

    /// Lists the arcs of each node behind one another, in the order of the edges.
    pub fn list_arcs(&mut self) {
        self.starts.clear();
        self.starts.resize(self.rest.len() + 2, 0);
        for &(a, b, _) in &self.edges {
            self.starts[a as usize + 2] += 1;
            self.starts[b as usize + 2] += 1;
        }
        for node in 2..self.starts.len() {
            self.starts[node] += self.starts[node - 1];
        }
        self.arcs.clear();
        self.arcs.resize(2 * self.edges.len(), Arc::default());
        for &(a, b, rest) in &self.edges {
            let [from_a, from_b] = [a, b].map(|node| {
                let next = &mut self.starts[node as usize + 1];
                *next += 1;
                *next - 1
            });
            self.arcs[from_a as usize] = Arc { to: b, rest, twin: from_b };
            self.arcs[from_b as usize] = Arc { to: a, rest, twin: from_a };
        }
        self.starts.pop();
    }

    /// Pushes flow along an arc.
    pub fn push(&mut self, at: u32, by: u32) {
        let twin = self.arcs[at as usize].twin;
        self.arcs[at as usize].rest -= by;
        let back = &mut self.arcs[twin as usize].rest;
        *back = back.saturating_add(by);
    }
}
