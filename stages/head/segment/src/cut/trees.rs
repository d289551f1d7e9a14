//! Two trees that grow over a graph from its terminals, and where they meet, flow is pushed.

use super::graph::{Arc, Graph, Lean};
use std::collections::VecDeque;

/// The tree that a node is in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Tree {
    Free,
    Source,
    Sink,
}

/// How a node hangs on its tree.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Parent {
    /// The node has no parent.
    None,
    /// It was cut off and looks for another parent.
    Orphan,
    Terminal,
    /// By the node at the end of this arc of its.
    Arc(u32),
}

#[derive(Debug, Clone, Copy)]
struct Node {
    tree: Tree,
    parent: Parent,
    /// Steps to the terminal, right at the time `seen`: a shorter way is the better parent.
    distance: u32,
    seen: u32,
    active: bool,
}

/// A graph with its buffers; after the first frames of a size it allocates nothing.
#[derive(Debug, Clone, Default)]
pub struct MinCut {
    graph: Graph,
    nodes: Vec<Node>,
    active: VecDeque<u32>,
    orphans: VecDeque<u32>,
    time: u32,
}

impl MinCut {
    /// Starts a graph of `nodes` nodes without edges.
    pub fn start(&mut self, nodes: usize) {
        self.graph.start(nodes);
    }

    /// Says which side a node belongs to. Comes before the node's edges.
    pub fn lean(&mut self, node: u32, lean: Lean) {
        self.graph.lean(node, lean);
    }

    /// Joins two nodes: to part them costs `capacity`, which is asked for only where they may be parted.
    pub fn join(&mut self, a: u32, b: u32, capacity: impl FnOnce() -> u32) {
        self.graph.join(a, b, capacity);
    }

    /// Cuts the graph where it is cheapest, and says what that costs. Of equal cuts, the one nearest to the source.
    pub fn cut(&mut self) -> u64 {
        self.graph.list_arcs();
        self.plant();
        let mut flow = 0;
        while let Some(node) = self.next_active() {
            let arcs = self.graph.arcs_of(node);
            for at in arcs {
                // Two trees may meet at one arc more than once.
                while let Some(meeting) = self.grow(node, at) {
                    flow += self.augment(meeting);
                    self.adopt();
                }
                if self.nodes[node as usize].tree == Tree::Free {
                    break;
                }
            }
        }
        flow
    }

    /// Whether a node is on the source's side of the last cut.
    #[must_use]
    pub fn with_source(&self, node: u32) -> bool {
        self.nodes.get(node as usize).is_some_and(|node| node.tree == Tree::Source)
    }

    /// Starts both trees with the nodes that lean to their terminals.
    fn plant(&mut self) {
        self.time = 0;
        self.active.clear();
        self.orphans.clear();
        self.nodes.clear();
        for number in 0..self.graph.rest.len() as u32 {
            let (tree, parent) = match self.graph.rest[number as usize].signum() {
                1 => (Tree::Source, Parent::Terminal),
                -1 => (Tree::Sink, Parent::Terminal),
                _ => (Tree::Free, Parent::None),
            };
            self.nodes.push(Node { tree, parent, distance: 1, seen: 0, active: false });
            if tree != Tree::Free {
                self.activate(number);
            }
        }
    }

    fn activate(&mut self, number: u32) {
        let node = &mut self.nodes[number as usize];
        if !node.active {
            node.active = true;
            self.active.push_back(number);
        }
    }

    fn next_active(&mut self) -> Option<u32> {
        loop {
            let number = self.active.pop_front()?;
            let node = &mut self.nodes[number as usize];
            node.active = false;
            if node.tree != Tree::Free {
                return Some(number);
            }
        }
    }

    /// What can still flow along an arc of a node, away from the source: along it in the source's tree, against it in the
    /// sink's.
    #[inline]
    fn outward(&self, tree: Tree, at: u32) -> u32 {
        let arc = self.graph.arcs[at as usize];
        if tree == Tree::Source { arc.rest } else { self.graph.arcs[arc.twin as usize].rest }
    }

    /// What can still flow between a node and a parent at the end of its arc.
    #[inline]
    fn inward(&self, tree: Tree, at: u32) -> u32 {
        let arc = self.graph.arcs[at as usize];
        if tree == Tree::Source { self.graph.arcs[arc.twin as usize].rest } else { arc.rest }
    }

    /// Takes the node at the end of an arc into the tree of `number`; or says where the two trees meet, as the arc from the
    /// source's to the sink's.
    #[inline]
    fn grow(&mut self, number: u32, at: u32) -> Option<u32> {
        let Node { tree, distance, seen, .. } = self.nodes[number as usize];
        if tree == Tree::Free || self.outward(tree, at) == 0 {
            return None;
        }
        let Arc { to, twin, .. } = self.graph.arcs[at as usize];
        let other = &mut self.nodes[to as usize];
        if other.tree == Tree::Free {
            (other.tree, other.parent) = (tree, Parent::Arc(twin));
            (other.distance, other.seen) = (distance + 1, seen);
            self.activate(to);
        } else if other.tree != tree {
            return Some(if tree == Tree::Source { at } else { twin });
        } else if other.seen <= seen && other.distance > distance + 1 && other.parent != Parent::Orphan {
            // A shorter way to the terminal.
            (other.parent, other.distance, other.seen) = (Parent::Arc(twin), distance + 1, seen);
        }
        None
    }

    /// Pushes as much as can flow through the arc between the trees, and makes orphans of what it fills.
    fn augment(&mut self, meeting: u32) -> u64 {
        let Arc { to, rest, twin } = self.graph.arcs[meeting as usize];
        let ends = [(Tree::Source, self.graph.arcs[twin as usize].to), (Tree::Sink, to)];
        let mut most = i64::from(rest);
        for (tree, end) in ends {
            let mut number = end;
            while let Parent::Arc(at) = self.nodes[number as usize].parent {
                most = most.min(i64::from(self.inward(tree, at)));
                number = self.graph.arcs[at as usize].to;
            }
            most = most.min(self.graph.rest[number as usize].abs());
        }
        // No arc carries more than a u32.
        let pushed = most as u32;
        self.graph.push(meeting, pushed);
        for (tree, end) in ends {
            let mut number = end;
            while let Parent::Arc(at) = self.nodes[number as usize].parent {
                let twin = self.graph.arcs[at as usize].twin;
                self.graph.push(if tree == Tree::Source { twin } else { at }, pushed);
                if self.inward(tree, at) == 0 {
                    self.nodes[number as usize].parent = Parent::Orphan;
                    self.orphans.push_back(number);
                }
                number = self.graph.arcs[at as usize].to;
            }
            let rest = &mut self.graph.rest[number as usize];
            *rest -= rest.signum() * most;
            if *rest == 0 {
                self.nodes[number as usize].parent = Parent::Orphan;
                self.orphans.push_back(number);
            }
        }
        u64::from(pushed)
    }

    /// Finds new parents for the orphans; what finds none leaves its tree.
    fn adopt(&mut self) {
        self.time += 1;
        while let Some(number) = self.orphans.pop_front() {
            let tree = self.nodes[number as usize].tree;
            let arcs = self.graph.arcs_of(number);
            let mut best: Option<(u32, u32)> = None;
            for at in arcs.clone() {
                let to = self.graph.arcs[at as usize].to;
                if self.nodes[to as usize].tree != tree || self.inward(tree, at) == 0 {
                    continue;
                }
                if let Some(distance) = self.distance_to_terminal(to)
                    && best.is_none_or(|(_, least)| distance < least)
                {
                    best = Some((at, distance));
                }
            }
            if let Some((at, distance)) = best {
                let node = &mut self.nodes[number as usize];
                (node.parent, node.distance, node.seen) = (Parent::Arc(at), distance + 1, self.time);
            } else {
                self.leave(number, tree);
            }
        }
    }

    /// Steps from a node to the terminal that its tree hangs on; `None` where it hangs on an orphan. What is found is
    /// remembered on the way, as long as no other path is augmented.
    fn distance_to_terminal(&mut self, number: u32) -> Option<u32> {
        let (mut at, mut steps) = (number, 0);
        let known = loop {
            let node = &self.nodes[at as usize];
            if node.seen == self.time && node.parent != Parent::Orphan {
                break node.distance;
            }
            match node.parent {
                Parent::Terminal => break 1,
                Parent::Arc(arc) => at = self.graph.arcs[arc as usize].to,
                Parent::Orphan | Parent::None => return None,
            }
            steps += 1;
        };
        let distance = known + steps;
        let mut at = number;
        for left in 0..=steps {
            let node = &mut self.nodes[at as usize];
            (node.distance, node.seen) = (distance - left, self.time);
            if let Parent::Arc(arc) = node.parent {
                at = self.graph.arcs[arc as usize].to;
            }
        }
        Some(distance)
    }

    /// Takes a node out of its tree: its children are orphans, and its neighbours may take it in again.
    fn leave(&mut self, number: u32, tree: Tree) {
        for at in self.graph.arcs_of(number) {
            let to = self.graph.arcs[at as usize].to;
            let Node { tree: other, parent, .. } = self.nodes[to as usize];
            if other != tree {
                continue;
            }
            if self.inward(tree, at) > 0 {
                self.activate(to);
            }
            if let Parent::Arc(of_child) = parent
                && self.graph.arcs[of_child as usize].to == number
            {
                self.nodes[to as usize].parent = Parent::Orphan;
                self.orphans.push_back(to);
            }
        }
        let node = &mut self.nodes[number as usize];
        (node.tree, node.parent) = (Tree::Free, Parent::None);
    }
}
