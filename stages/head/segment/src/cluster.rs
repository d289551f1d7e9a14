//! Euclidean clusters: points joined by steps of at most a tolerance.
//!
//! Points go into cells of tolerance / sqrt(3), in which any two are near enough. Two cells within two steps of each
//! other join if any point of one is near enough to one of the other. This gives the clusters of single linkage exactly.

use crate::cells::{NO_CELL, SortedCells};
use crate::forest::root;
use crate::sweep::Sweep;

/// Marks a point that is in no cluster that was kept.
pub const NO_CLUSTER: u32 = u32::MAX;

/// Cells of points that are near enough to each other are at most this many steps apart.
const STEPS: u64 = 2;

/// The clustering with its buffers; after the first frames it allocates nothing.
#[derive(Debug, Clone, Default)]
pub struct EuclideanClusters {
    cells: SortedCells,
    sweep: Sweep,
    parents: Vec<u32>,
    counts: Vec<u32>,
    roots: Vec<u32>,
    sizes: Vec<u32>,
    labels: Vec<u32>,
}

#[inline]
fn distance_squared(a: [f32; 3], b: [f32; 3]) -> f32 {
    let [x, y, z] = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    x * x + y * y + z * z
}

impl EuclideanClusters {
    /// A clustering without buffers yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Joins `points` (finite, in metres) whose distance is at most `tolerance` metres, and keeps the clusters of at
    /// least `min_points`: the largest first, among equals the one with the earliest point.
    pub fn find(&mut self, points: &[[f32; 3]], tolerance: f64, min_points: usize) {
        // A little narrower than tolerance / sqrt(3), so that rounding parts no cell's points.
        self.cells.sort(points, 3.0_f64.sqrt() / tolerance * (1.0 + 1e-6));
        self.parents.clear();
        self.parents.extend(0..self.cells.index().len() as u32);
        let near = (tolerance * tolerance) as f32;
        let (cells, parents) = (&self.cells, &mut self.parents);
        self.sweep.pairs(cells.index().keys(), STEPS, |cell, other| {
            let (a, b) = (root(parents, cell), root(parents, other));
            if a != b && touch(cells, points, cell, other, near) {
                parents[a.max(b) as usize] = a.min(b);
            }
        });
        self.label(points.len(), min_points);
    }

    /// Points in each kept cluster, the largest first.
    #[must_use]
    pub fn sizes(&self) -> &[u32] {
        &self.sizes
    }

    /// For each point the place of its cluster in [`sizes`](Self::sizes), or [`NO_CLUSTER`].
    #[must_use]
    pub fn labels(&self) -> &[u32] {
        &self.labels
    }

    /// Numbers the roots by size and gives each point its cluster's number.
    fn label(&mut self, points: usize, min_points: usize) {
        self.counts.clear();
        self.counts.resize(self.cells.index().len(), 0);
        self.roots.clear();
        for cell in 0..self.cells.index().len() as u32 {
            let root = root(&mut self.parents, cell);
            if root == cell {
                self.roots.push(cell);
            }
            self.counts[root as usize] += self.cells.members(cell).len() as u32;
        }
        self.roots.retain(|&root| self.counts[root as usize] as usize >= min_points);
        // Cells are numbered by their first point, and a root is the first cell of its cluster.
        self.roots.sort_unstable_by_key(|&root| (std::cmp::Reverse(self.counts[root as usize]), root));
        self.sizes.clear();
        self.sizes.extend(self.roots.iter().map(|&root| self.counts[root as usize]));
        self.counts.fill(NO_CLUSTER);
        for (number, &root) in self.roots.iter().enumerate() {
            self.counts[root as usize] = number as u32;
        }
        self.labels.clear();
        for point in 0..points {
            let label = match self.cells.cell_of_point()[point] {
                NO_CELL => NO_CLUSTER,
                cell => self.counts[root(&mut self.parents, cell) as usize],
            };
            self.labels.push(label);
        }
    }
}

/// Whether any point of one cell is near enough to one of the other.
fn touch(cells: &SortedCells, points: &[[f32; 3]], a: u32, b: u32, near: f32) -> bool {
    let close = |i: u32, j: u32| distance_squared(points[i as usize], points[j as usize]) <= near;
    cells.members(a).iter().any(|&i| cells.members(b).iter().any(|&j| close(i, j)))
}

/// The representative cell of `cell`'s cluster, with the path to it halved.
#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Single linkage by comparing all pairs.
    fn by_all_pairs(points: &[[f32; 3]], tolerance: f64) -> Vec<u32> {
        let mut parents: Vec<u32> = (0..points.len() as u32).collect();
        for i in 0..points.len() {
            for j in 0..i {
                if distance_squared(points[i], points[j]) <= (tolerance * tolerance) as f32 {
                    let (a, b) = (root(&mut parents, i as u32), root(&mut parents, j as u32));
                    parents[a.max(b) as usize] = a.min(b);
                }
            }
        }
        (0..points.len() as u32).map(|i| root(&mut parents, i)).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn clusters_are_those_of_all_pairs(
            points in prop::collection::vec(prop::array::uniform3(-0.2..0.2_f32), 0..150),
            tolerance in 0.02..0.1_f64,
        ) {
            let mut clusters = EuclideanClusters::new();
            clusters.find(&points, tolerance, 1);
            let expected = by_all_pairs(&points, tolerance);
            for i in 0..points.len() {
                for j in 0..i {
                    prop_assert_eq!(clusters.labels()[i] == clusters.labels()[j], expected[i] == expected[j]);
                }
            }
            prop_assert_eq!(clusters.sizes().iter().sum::<u32>() as usize, points.len());
        }
    }

    #[test]
    fn largest_cluster_comes_first_and_small_ones_are_left_out() {
        let line = |start: f32, n: usize| (0..n).map(move |i| [start + i as f32 * 0.01, 0.0, 1.0]);
        let points: Vec<_> = line(0.0, 5).chain(line(1.0, 9)).chain(line(2.0, 2)).collect();
        let mut clusters = EuclideanClusters::new();
        clusters.find(&points, 0.02, 3);
        assert_eq!(clusters.sizes(), [9, 5]);
        assert_eq!(clusters.labels()[..5], [1; 5]);
        assert_eq!(clusters.labels()[5..14], [0; 9]);
        assert_eq!(clusters.labels()[14..], [NO_CLUSTER; 2]);
    }

    #[test]
    fn second_frame_remembers_nothing_of_the_first() {
        let points: Vec<_> = (0..500).map(|i| [i as f32 * 0.013, (i % 7) as f32 * 0.1, 1.0]).collect();
        let mut used = EuclideanClusters::new();
        used.find(&points, 0.05, 1);
        used.find(&points[..100], 0.11, 2);
        let mut fresh = EuclideanClusters::new();
        fresh.find(&points[..100], 0.11, 2);
        assert_eq!((used.labels(), used.sizes()), (fresh.labels(), fresh.sizes()));
    }
}
