//! Summits of a landscape: places from which every way to higher ground leads down first, and how far down.

use crate::forest::root;

/// The search with its buffers; after the first frames of a size it allocates nothing.
///
/// Within it a node goes by its rank: 0 is the highest.
#[derive(Debug, Clone, Default)]
pub struct Summits {
    heights: Vec<f64>,
    /// The nodes by rank, and the ranks by node.
    order: Vec<u32>,
    ranks: Vec<u32>,
    /// Where in `higher` each rank's neighbours on higher ground start, in the order of the edges; one more at the end.
    starts: Vec<u32>,
    higher: Vec<u32>,
    /// For each rank one nearer to the summit it belongs to, or itself.
    parents: Vec<u32>,
    /// Nodes of the island of each summit, by rank.
    sizes: Vec<u32>,
    depths: Vec<f64>,
    prominence: Vec<f64>,
    basins: Vec<u32>,
}

impl Summits {
    /// Takes the heights of the nodes, in any unit; of equals the first node counts as the higher one.
    pub fn measure(&mut self, heights: impl IntoIterator<Item = f64>) {
        self.heights.clear();
        self.heights.extend(heights);
        let heights = &self.heights;
        self.order.clear();
        self.order.extend(0..heights.len() as u32);
        self.order
            .sort_unstable_by(|&a, &b| heights[b as usize].total_cmp(&heights[a as usize]).then(a.cmp(&b)));
        self.ranks.clear();
        self.ranks.resize(heights.len(), 0);
        for (rank, &node) in self.order.iter().enumerate() {
            self.ranks[node as usize] = rank as u32;
        }
    }

    /// Height of each node.
    #[must_use]
    pub fn heights(&self) -> &[f64] {
        &self.heights
    }

    /// How far down the way from each node to higher ground leads (its topographic prominence), in the unit of the
    /// heights: infinite for the highest of what is joined by `edges`, and 0 for all but summits. A summit counts whose
    /// island, down to where the way leads, has at least `least` nodes.
    pub fn find(&mut self, edges: &[[u32; 2]], least: u32) -> &[f64] {
        self.list_higher(edges);
        let Self { heights, order, starts, higher, parents, sizes, depths, .. } = self;
        let height = |rank: u32| heights[order[rank as usize] as usize];
        parents.clear();
        sizes.clear();
        sizes.resize(order.len(), 1);
        depths.clear();
        depths.resize(order.len(), f64::INFINITY);
        // The water falls; where two islands join, the summit of the lower one is known.
        for (node, bounds) in (0..order.len() as u32).zip(starts.windows(2)) {
            parents.push(node);
            for &other in &higher[bounds[0] as usize..bounds[1] as usize] {
                let [a, b] = [node, other].map(|n| root(parents, n));
                if a == b {
                    continue;
                }
                let [low, high] = [a.max(b), a.min(b)].map(|rank| rank as usize);
                parents[low] = high as u32;
                depths[low] = if sizes[low] >= least { height(low as u32) - height(node) } else { 0.0 };
                sizes[high] += sizes[low];
            }
        }
        let counts = |rank: usize| depths[rank] < f64::INFINITY || sizes[rank] >= least;
        self.prominence.clear();
        let of_ranks = self.ranks.iter().map(|&rank| rank as usize);
        self.prominence.extend(of_ranks.map(|rank| if counts(rank) { depths[rank] } else { 0.0 }));
        &self.prominence
    }

    /// What the last search found.
    #[must_use]
    pub fn prominence(&self) -> &[f64] {
        &self.prominence
    }

    /// Finds for each node of the last search the summit to which its steepest way up leads. A summit less prominent
    /// than `least` belongs to the first other summit that its surroundings meet.
    pub fn part(&mut self, least: f64) -> &[u32] {
        let Self { order, ranks, starts, higher, parents, prominence, basins, .. } = self;
        let is_low = |rank: u32| prominence[order[rank as usize] as usize] < least;
        parents.clear();
        for (node, bounds) in (0..order.len() as u32).zip(starts.windows(2)) {
            let higher = &higher[bounds[0] as usize..bounds[1] as usize];
            let steepest = higher.iter().min().map_or(node, |&up| root(parents, up));
            parents.push(steepest);
            for &other in higher {
                let [own, met] = [node, other].map(|n| root(parents, n));
                if is_low(met) {
                    parents[met as usize] = own;
                } else if is_low(own) {
                    parents[own as usize] = met;
                }
            }
        }
        basins.clear();
        basins.extend(ranks.iter().map(|&rank| order[root(parents, rank) as usize]));
        basins
    }

    /// What the last parting found.
    #[must_use]
    pub fn basins(&self) -> &[u32] {
        &self.basins
    }

    /// Lists for each rank its neighbours on higher ground.
    fn list_higher(&mut self, edges: &[[u32; 2]]) {
        let Self { ranks, starts, higher, .. } = self;
        let by_rank = |&[a, b]: &[u32; 2]| {
            let (a, b) = (ranks[a as usize], ranks[b as usize]);
            [a.max(b), a.min(b)]
        };
        starts.clear();
        starts.resize(ranks.len() + 2, 0);
        edges.iter().for_each(|edge| starts[by_rank(edge)[0] as usize + 2] += 1);
        for rank in 2..starts.len() {
            starts[rank] += starts[rank - 1];
        }
        higher.clear();
        higher.resize(edges.len(), 0);
        for [low, high] in edges.iter().map(by_rank) {
            let next = &mut starts[low as usize + 1];
            higher[*next as usize] = high;
            *next += 1;
        }
        starts.pop();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The prominences of nodes of these heights.
    fn found(heights: &[f64], edges: &[[u32; 2]], least: u32) -> Vec<f64> {
        let mut summits = Summits::default();
        // Of a search before nothing is left.
        summits.measure([3.0, 2.0, 3.0]);
        summits.find(&[[0, 1], [1, 2]], 1);
        summits.measure(heights.iter().copied());
        summits.find(edges, least).to_vec()
    }

    #[test]
    fn a_ridge_with_three_summits_has_their_prominences() {
        let heights = [1.0, 5.0, 2.0, 4.0, 3.0, 7.0, 0.0];
        let edges: Vec<_> = (0..6).map(|i| [i, i + 1]).collect();
        assert_eq!(found(&heights, &edges, 1), [0.0, 3.0, 0.0, 1.0, 0.0, f64::INFINITY, 0.0]);
        // The islands of the two lower summits have two nodes each where they join another.
        assert_eq!(found(&heights, &edges, 3), [0.0, 0.0, 0.0, 0.0, 0.0, f64::INFINITY, 0.0]);
        assert_eq!(found(&[2.0, 1.0], &[], 2), [0.0; 2]);
        // Flat ground has one summit, and islands have one each.
        assert_eq!(found(&[1.0; 3], &[[0, 1], [1, 2]], 1), [f64::INFINITY, 0.0, 0.0]);
        assert_eq!(found(&[2.0, 1.0], &[], 1), [f64::INFINITY; 2]);
        assert!(found(&[], &[], 1).is_empty());
    }

    #[test]
    fn basins_part_where_the_way_between_two_summits_is_lowest() {
        let edges: Vec<_> = (0..6).map(|i| [i, i + 1]).collect();
        let mut summits = Summits::default();
        summits.measure([1.0, 5.0, 2.0, 4.0, 3.0, 7.0, 0.0]);
        summits.find(&edges, 1);
        assert_eq!(summits.part(0.5), [1, 1, 1, 3, 5, 5, 5]);
        // The middle one is no summit of its own: it goes to the one that its surroundings meet first.
        assert_eq!(summits.part(2.0), [1, 1, 1, 5, 5, 5, 5]);
        assert_eq!(summits.part(4.0), [5; 7]);
    }
}
