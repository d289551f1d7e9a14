//! Summits of a landscape: places from which every way to higher ground leads down first, and how far down.

use std::cmp::Reverse;

/// The search with its buffers; after the first frames of a size it allocates nothing.
#[derive(Debug, Clone, Default)]
pub struct Summits {
    order: Vec<u32>,
    /// For each node one nearer to the summit it belongs to, or itself; [`NONE`] while the water stands over it.
    parents: Vec<u32>,
    starts: Vec<u32>,
    neighbours: Vec<u32>,
    /// Nodes of the island of each summit.
    sizes: Vec<u32>,
    prominence: Vec<f64>,
}

const NONE: u32 = u32::MAX;

impl Summits {
    /// A search without buffers yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// How far down the way from each node to higher ground leads (its topographic prominence), in the unit of
    /// `heights`: infinite for the highest of what is joined by `edges`, and 0 for all but summits. A summit counts whose
    /// island, down to where the way leads, has at least `least` nodes.
    pub fn find(&mut self, heights: &[f64], edges: &[[u32; 2]], least: u32) -> &[f64] {
        self.list_neighbours(heights.len(), edges);
        self.order.clear();
        self.order.extend(0..heights.len() as u32);
        self.order
            .sort_unstable_by(|&a, &b| heights[b as usize].total_cmp(&heights[a as usize]).then(a.cmp(&b)));
        self.parents.clear();
        self.parents.resize(heights.len(), NONE);
        self.prominence.clear();
        self.prominence.resize(heights.len(), 0.0);
        self.sizes.clear();
        self.sizes.resize(heights.len(), 1);
        // The water falls; where two islands join, the summit of the lower one is known.
        for at in 0..self.order.len() {
            let node = self.order[at];
            self.parents[node as usize] = node;
            self.prominence[node as usize] = f64::INFINITY;
            let [from, to] = [node, node + 1].map(|n| self.starts[n as usize] as usize);
            for place in from..to {
                let other = self.neighbours[place];
                if self.parents[other as usize] == NONE {
                    continue;
                }
                let (a, b) = (self.summit(node), self.summit(other));
                if a == b {
                    continue;
                }
                let key = |n: u32| (heights[n as usize], Reverse(n));
                let (low, high) = if key(a) < key(b) { (a, b) } else { (b, a) };
                self.parents[low as usize] = high;
                let counts = self.sizes[low as usize] >= least;
                self.sizes[high as usize] += self.sizes[low as usize];
                let down = heights[low as usize] - heights[node as usize];
                self.prominence[low as usize] = if counts { down } else { 0.0 };
            }
        }
        for (node, prominence) in self.prominence.iter_mut().enumerate() {
            if *prominence == f64::INFINITY && self.sizes[node] < least {
                *prominence = 0.0;
            }
        }
        &self.prominence
    }

    fn list_neighbours(&mut self, nodes: usize, edges: &[[u32; 2]]) {
        self.starts.clear();
        self.starts.resize(nodes + 2, 0);
        for &[a, b] in edges {
            self.starts[a as usize + 2] += 1;
            self.starts[b as usize + 2] += 1;
        }
        for node in 2..self.starts.len() {
            self.starts[node] += self.starts[node - 1];
        }
        self.neighbours.clear();
        self.neighbours.resize(2 * edges.len(), 0);
        for &[a, b] in edges {
            for (from, to) in [(a, b), (b, a)] {
                let next = &mut self.starts[from as usize + 1];
                self.neighbours[*next as usize] = to;
                *next += 1;
            }
        }
        self.starts.pop();
    }

    /// The summit of the island that a node is on, with the path to it halved.
    fn summit(&mut self, mut node: u32) -> u32 {
        while self.parents[node as usize] != node {
            self.parents[node as usize] = self.parents[self.parents[node as usize] as usize];
            node = self.parents[node as usize];
        }
        node
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ridge_with_three_summits_has_their_prominences() {
        let heights = [1.0, 5.0, 2.0, 4.0, 3.0, 7.0, 0.0];
        let edges: Vec<_> = (0..6).map(|i| [i, i + 1]).collect();
        let mut summits = Summits::new();
        assert_eq!(summits.find(&heights, &edges, 1), [0.0, 3.0, 0.0, 1.0, 0.0, f64::INFINITY, 0.0]);
        // The islands of the two lower summits have two nodes each where they join another.
        let larger = summits.find(&heights, &edges, 3);
        assert_eq!(larger, [0.0, 0.0, 0.0, 0.0, 0.0, f64::INFINITY, 0.0]);
        assert_eq!(summits.find(&[2.0, 1.0], &[], 2), [0.0; 2]);
        // Flat ground has one summit, and islands have one each.
        assert_eq!(summits.find(&[1.0; 3], &[[0, 1], [1, 2]], 1), [f64::INFINITY, 0.0, 0.0]);
        assert_eq!(summits.find(&[2.0, 1.0], &[], 1), [f64::INFINITY; 2]);
        assert!(summits.find(&[], &[], 1).is_empty());
    }
}
