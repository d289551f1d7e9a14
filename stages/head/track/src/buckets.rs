//! Points sorted into cubic cells.

use core::ops::Range;

use nalgebra::Vector3;

/// Bits of a key for one coordinate.
const BITS: u32 = 21;

/// Points in the order of their cells.
#[derive(Debug, Clone)]
pub struct Buckets {
    corner: Vector3<f64>,
    width: f64,
    /// Cell and number of each point, sorted.
    keys: Vec<(u64, u32)>,
    points: Vec<Vector3<f64>>,
}

impl Buckets {
    /// Sorts finite points (m) into cells `width` metres wide.
    #[must_use]
    pub fn new(points: &[Vector3<f64>], width: f64) -> Self {
        let first = points.first().copied().unwrap_or_default();
        let corner = points.iter().fold(first, |least, p| least.inf(p));
        let mut buckets = Self { corner, width, keys: Vec::with_capacity(points.len()), points: Vec::new() };
        for (number, point) in points.iter().enumerate() {
            let [x, y, z] = buckets.cell(point);
            buckets.keys.push((key(x, y, z), number as u32));
        }
        buckets.keys.sort_unstable();
        buckets.points = buckets.keys.iter().map(|&(_, i)| points[i as usize]).collect();
        buckets
    }

    /// The mean of each cell's points, in the order of the cells.
    #[must_use]
    pub fn means(&self) -> Vec<Vector3<f64>> {
        let same = |a: &(u64, u32), b: &(u64, u32)| a.0 == b.0;
        let mut means = Vec::new();
        let mut at = 0;
        for cell in self.keys.chunk_by(same) {
            let inside = &self.points[at..at + cell.len()];
            let first = inside[0];
            let sum: Vector3<f64> = inside.iter().map(|p| p - first).sum();
            means.push(first + sum / inside.len() as f64);
            at += cell.len();
        }
        means
    }

    /// For each point, in the order in which they were given, the number of its cell; and the number of cells.
    #[must_use]
    pub fn numbers(&self) -> (Vec<u32>, usize) {
        let mut numbers = vec![0; self.keys.len()];
        let mut count = 0;
        for cell in self.keys.chunk_by(|a, b| a.0 == b.0) {
            for &(_, point) in cell {
                numbers[point as usize] = count as u32;
            }
            count += 1;
        }
        (numbers, count)
    }

    /// Writes the points within `radius`, at most a cell's width, of `centre` into `found`.
    pub fn within(&self, centre: &Vector3<f64>, radius: f64, found: &mut Vec<Vector3<f64>>) {
        found.clear();
        let [x, y, z] = self.cell(centre);
        let squared = radius * radius;
        for i in x.saturating_sub(1)..=x + 1 {
            for j in y.saturating_sub(1)..=y + 1 {
                let row = self.row(key(i, j, z.saturating_sub(1)), key(i, j, z + 1));
                found.extend(self.points[row].iter().filter(|p| (*p - centre).norm_squared() < squared));
            }
        }
    }

    /// The points whose keys lie between two, both included.
    fn row(&self, from: u64, to: u64) -> Range<usize> {
        let start = self.keys.partition_point(|k| k.0 < from);
        let length = self.keys[start..].partition_point(|k| k.0 <= to);
        start..start + length
    }

    fn cell(&self, point: &Vector3<f64>) -> [u64; 3] {
        let d = (point - self.corner) / self.width;
        // One less than the most, so that a neighbour's number fits too.
        [d.x, d.y, d.z].map(|c| (c as u64).min((1 << BITS) - 2))
    }
}

fn key(x: u64, y: u64, z: u64) -> u64 {
    x << (2 * BITS) | y << BITS | z
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn means_are_those_of_the_cells() {
        let points = [[0.0, 0.0, 0.0], [0.95, 0.0, 0.0], [0.05, 0.02, 0.0]].map(Vector3::from);
        let buckets = Buckets::new(&points, 0.1);
        assert_eq!(buckets.means(), [[0.025, 0.01, 0.0], [0.95, 0.0, 0.0]].map(Vector3::from));
        assert_eq!(buckets.numbers(), (vec![0, 1, 0], 2));
    }

    proptest! {
        #[test]
        fn points_within_the_radius_are_those_of_all_pairs(
            points in prop::collection::vec(prop::array::uniform3(-1.0..1.0f64), 1..80),
            centre in prop::array::uniform3(-1.0..1.0f64),
        ) {
            let points: Vec<_> = points.into_iter().map(Vector3::from).collect();
            let centre = Vector3::from(centre).sup(&points.iter().fold(points[0], |a, p| a.inf(p)));
            let mut found = Vec::new();
            Buckets::new(&points, 0.5).within(&centre, 0.5, &mut found);
            let mut expected: Vec<_> =
                points.into_iter().filter(|p| (p - centre).norm_squared() < 0.25).collect();
            let order = |a: &Vector3<f64>, b: &Vector3<f64>| a.as_slice().partial_cmp(b.as_slice()).unwrap();
            found.sort_by(order);
            expected.sort_by(order);
            prop_assert_eq!(found, expected);
        }
    }
}
