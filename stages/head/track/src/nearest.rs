//! Which of a fixed set of places is nearest: a table over space, made once and read in constant time.

use nalgebra::Vector3;

/// Cells at most; a larger space gets larger cells.
const CELLS_MOST: f64 = 1e6;
/// Marks a cell that no place has reached.
const NONE: u32 = u32::MAX;

/// A box of cubic cells, each of which knows the place that is nearest to its centre.
#[derive(Debug, Clone)]
pub struct NearestTable {
    /// Least corner, m.
    corner: Vector3<f64>,
    cell: f64,
    inverse_cell: f64,
    size: [usize; 3],
    nearest: Vec<u32>,
}

impl NearestTable {
    /// A table over the box of `places` (m, finite) and `margin` metres around it, with cells of `cell` metres or more.
    /// `None` where there is no place.
    #[must_use]
    pub fn new(places: &[Vector3<f64>], margin: f64, cell: f64) -> Option<Self> {
        let first = *places.first()?;
        let (least, greatest) = places.iter().fold((first, first), |(a, b), p| (a.inf(p), b.sup(p)));
        let extent = (greatest - least).add_scalar(2.0 * margin);
        let cell = cell.max((extent.product() / CELLS_MOST).cbrt());
        let size = [0, 1, 2].map(|i| (extent[i] / cell) as usize + 1);
        let mut table = Self {
            corner: least.add_scalar(-margin),
            cell,
            inverse_cell: 1.0 / cell,
            size,
            nearest: vec![NONE; size.iter().product()],
        };
        for (i, place) in places.iter().enumerate() {
            if let Some(at) = table.index(place) {
                table.offer(places, at, table.centre(at), i as u32);
            }
        }
        table.spread(places);
        Some(table)
    }

    /// The place nearest to the centre of the point's cell; `None` outside the box.
    #[inline]
    #[must_use]
    pub fn nearest(&self, point: &Vector3<f64>) -> Option<usize> {
        self.index(point).map(|i| self.nearest[i] as usize)
    }

    #[inline]
    fn index(&self, point: &Vector3<f64>) -> Option<usize> {
        let d = (point - self.corner) * self.inverse_cell;
        let [nx, ny, nz] = self.size;
        // Not below zero, written so that NaN is outside.
        let inside = d.x >= 0.0 && d.y >= 0.0 && d.z >= 0.0;
        let (x, y, z) = (d.x as usize, d.y as usize, d.z as usize);
        (inside && x < nx && y < ny && z < nz).then(|| (z * ny + y) * nx + x)
    }

    fn centre(&self, index: usize) -> Vector3<f64> {
        let [nx, ny, _] = self.size;
        let at = [index % nx, index / nx % ny, index / (nx * ny)].map(|i| i as f64 + 0.5);
        self.corner + Vector3::from(at) * self.cell
    }

    fn offer(&mut self, places: &[Vector3<f64>], at: usize, centre: Vector3<f64>, candidate: u32) {
        let distance = |i: u32| places.get(i as usize).map_or(f64::INFINITY, |p| (p - centre).norm_squared());
        if distance(candidate) < distance(self.nearest[at]) {
            self.nearest[at] = candidate;
        }
    }

    /// Hands each cell's place to its neighbours, in a sweep from corner to corner and one back (Danielsson 1980).
    fn spread(&mut self, places: &[Vector3<f64>]) {
        let cells = self.nearest.len();
        for at in 0..cells {
            self.take_from_neighbours(places, at, Sweep::Up);
        }
        for at in (0..cells).rev() {
            self.take_from_neighbours(places, at, Sweep::Down);
        }
    }

    /// Offers a cell what those of its 26 neighbours have that a sweep has passed.
    fn take_from_neighbours(&mut self, places: &[Vector3<f64>], at: usize, sweep: Sweep) {
        let [nx, ny, nz] = self.size.map(|n| n as isize);
        let (x, y, z) = (at as isize % nx, at as isize / nx % ny, at as isize / (nx * ny));
        let centre = self.centre(at);
        let mut last = self.nearest[at];
        for &(dx, dy, dz) in &PASSED {
            let (dx, dy, dz) = match sweep {
                Sweep::Up => (dx, dy, dz),
                Sweep::Down => (-dx, -dy, -dz),
            };
            let (x, y, z) = (x + dx, y + dy, z + dz);
            if x < 0 || y < 0 || z < 0 || x >= nx || y >= ny || z >= nz {
                continue;
            }
            let candidate = self.nearest[((z * ny + y) * nx + x) as usize];
            if candidate != last && candidate != NONE {
                self.offer(places, at, centre, candidate);
                last = candidate;
            }
        }
    }
}

#[derive(Clone, Copy)]
enum Sweep {
    Up,
    Down,
}

/// The neighbours with a lower index.
const PASSED: [(isize, isize, isize); 13] = [
    (-1, 0, 0),
    (-1, -1, 0),
    (0, -1, 0),
    (1, -1, 0),
    (-1, -1, -1),
    (0, -1, -1),
    (1, -1, -1),
    (-1, 0, -1),
    (0, 0, -1),
    (1, 0, -1),
    (-1, 1, -1),
    (0, 1, -1),
    (1, 1, -1),
];

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn no_place_has_no_table() {
        assert!(NearestTable::new(&[], 0.01, 0.005).is_none());
    }

    #[test]
    fn outside_the_box_and_no_number_have_no_nearest() {
        let table = NearestTable::new(&[Vector3::zeros()], 0.01, 0.005).unwrap();
        assert_eq!(table.nearest(&Vector3::new(0.009, 0.0, -0.009)), Some(0));
        assert_eq!(table.nearest(&Vector3::new(0.2, 0.0, 0.0)), None);
        assert_eq!(table.nearest(&Vector3::new(-0.2, 0.0, 0.0)), None);
        assert_eq!(table.nearest(&Vector3::new(f64::NAN, 0.0, 0.0)), None);
    }

    proptest! {
        #[test]
        fn found_place_is_at_most_a_cells_diagonal_farther_than_the_nearest(
            places in prop::collection::vec(prop::array::uniform3(-0.1..0.1f64), 1..60),
            asked in prop::collection::vec(prop::array::uniform3(-0.12..0.12f64), 20),
        ) {
            let places: Vec<_> = places.into_iter().map(Vector3::from).collect();
            let table = NearestTable::new(&places, 0.03, 0.01).unwrap();
            for point in asked.into_iter().map(Vector3::from) {
                let Some(found) = table.nearest(&point) else { continue };
                let least = places.iter().map(|p| (p - point).norm()).fold(f64::INFINITY, f64::min);
                // Half a diagonal between point and centre counts twice; sweeps may miss by a little.
                prop_assert!((places[found] - point).norm() <= least + 0.01 * 1.8);
            }
        }
    }
}
