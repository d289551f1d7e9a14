//! Summits of a landscape: places from which every way to higher ground leads down first, and how far down.

use crate::forest::root;
use std::cmp::{Ordering, Reverse};

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
    basins: Vec<u32>,
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
                let [a, b] = [node, other].map(|n| root(&mut self.parents, n));
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

    /// What the last search found.
    #[must_use]
    pub fn prominence(&self) -> &[f64] {
        &self.prominence
    }

    /// For each node of the last search the summit that water on it would stand under: the one that its steepest way up
    /// leads to. A summit less prominent than `least` belongs to the first other one that its surroundings meet.
    pub fn basins(&mut self, heights: &[f64], least: f64) -> &[u32] {
        let Self { order, starts, neighbours, prominence, basins, .. } = self;
        basins.clear();
        basins.resize(heights.len(), NONE);
        let key = |n: u32| (heights[n as usize], Reverse(n));
        let higher = |a: &u32, b: &u32| key(*a).partial_cmp(&key(*b)).unwrap_or(Ordering::Equal);
        for &node in order.iter() {
            let [from, to] = [node, node + 1].map(|n| starts[n as usize] as usize);
            let beside = &neighbours[from..to];
            let steepest = beside.iter().copied().filter(|&n| basins[n as usize] != NONE).max_by(higher);
            basins[node as usize] = steepest.map_or(node, |up| root(basins, up));
            for &other in beside {
                if basins[other as usize] == NONE {
                    continue;
                }
                let [own, met] = [node, other].map(|n| root(basins, n));
                if prominence[met as usize] < least {
                    basins[met as usize] = own;
                } else if prominence[own as usize] < least {
                    basins[own as usize] = met;
                }
            }
        }
        (0..heights.len() as u32).for_each(|node| basins[node as usize] = root(basins, node));
        &self.basins
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

    #[test]
    fn basins_part_where_the_way_between_two_summits_is_lowest() {
        let heights = [1.0, 5.0, 2.0, 4.0, 3.0, 7.0, 0.0];
        let edges: Vec<_> = (0..6).map(|i| [i, i + 1]).collect();
        let mut summits = Summits::new();
        summits.find(&heights, &edges, 1);
        assert_eq!(summits.basins(&heights, 0.5), [1, 1, 1, 3, 5, 5, 5]);
        // The middle one is no summit of its own: it goes to the one that its surroundings meet first.
        assert_eq!(summits.basins(&heights, 2.0), [1, 1, 1, 5, 5, 5, 5]);
        assert_eq!(summits.basins(&heights, 4.0), [5; 7]);
    }
}
