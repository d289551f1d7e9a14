//! The k nearest neighbours of each point, in cells.

use crate::cells::SortedCells;

/// Points sorted into cells, with their buffers; after the first frames of a size it allocates nothing.
#[derive(Debug, Clone, Default)]
pub struct Neighbours {
    cells: SortedCells,
    side: f64,
}

/// Largest number of rings of cells around a point's own that are searched: farther points are no neighbours.
const RINGS: i32 = 3;

impl Neighbours {
    /// Sorts `points` (finite, in metres) into cells `side` metres wide.
    pub fn sort(&mut self, points: &[[f32; 3]], side: f64) {
        self.side = side;
        self.cells.sort(points, 1.0 / side);
    }

    /// The `k` points nearest to a point, itself left out: squared distances in square metres and numbers, the nearest
    /// first, among equals the one with the smaller number. Fewer where fewer are within three cells.
    pub fn nearest(&self, points: &[[f32; 3]], point: usize, k: usize, found: &mut Vec<(f32, u32)>) {
        found.clear();
        let index = self.cells.index();
        let own = self.cells.cell_of_point().get(point);
        let Some(key) = own.and_then(|&cell| index.keys().get(cell as usize)) else { return };
        let at = points[point];
        for ring in 0..=RINGS {
            for by in ring_of_cells(ring) {
                let Some(cell) = index.get(key.offset(by)) else { continue };
                for &other in self.cells.members(cell).iter().filter(|&&other| other as usize != point) {
                    let p = points[other as usize];
                    let [x, y, z] = [p[0] - at[0], p[1] - at[1], p[2] - at[2]];
                    found.push((x * x + y * y + z * z, other));
                }
            }
            // All that is nearer than a ring's width has been seen.
            let sure = f64::from(ring) * self.side;
            if found.iter().filter(|(d, _)| f64::from(*d) <= sure * sure).count() >= k {
                break;
            }
        }
        let order = |a: &(f32, u32), b: &(f32, u32)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
        if found.len() > k {
            found.select_nth_unstable_by(k, order);
            found.truncate(k);
        }
        found.sort_unstable_by(order);
    }
}

/// The offsets at a Chebyshev distance of `ring`.
fn ring_of_cells(ring: i32) -> impl Iterator<Item = [i32; 3]> {
    let side = -ring..=ring;
    side.clone().flat_map(move |x| {
        let side = -ring..=ring;
        side.clone().flat_map(move |y| {
            let on_face = x.abs() == ring || y.abs() == ring;
            // Within the faces across z only the two ends are on the ring.
            let step = if on_face || ring == 0 { 1 } else { 2 * ring as usize };
            (-ring..=ring).step_by(step).map(move |z| [x, y, z])
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn neighbours_are_those_of_all_pairs(
            points in prop::collection::vec(prop::array::uniform3(-0.1..0.1_f32), 1..120),
            side in 0.02..0.1_f64,
            k in 1..12_usize,
        ) {
            let mut neighbours = Neighbours::default();
            neighbours.sort(&points, side);
            let mut found = Vec::new();
            for i in 0..points.len() {
                neighbours.nearest(&points, i, k, &mut found);
                let mut all: Vec<(f32, u32)> = (0..points.len()).filter(|&j| j != i).map(|j| {
                    let [x, y, z] = [0, 1, 2].map(|a| points[j][a] - points[i][a]);
                    (x * x + y * y + z * z, j as u32)
                }).collect();
                all.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                all.truncate(k);
                // What is farther than the rings reach may be missing.
                let sure = (f64::from(RINGS) * side) as f32;
                let near = all.iter().take_while(|(d, _)| *d < sure * sure).count();
                prop_assert_eq!(&found[..near], &all[..near]);
                prop_assert!(found.len() <= k);
            }
        }
    }

    #[test]
    fn a_ring_has_the_cells_of_a_cubes_surface() {
        for ring in 0..4 {
            let cells: Vec<_> = ring_of_cells(ring).collect();
            assert!(cells.iter().all(|by| by.iter().map(|c| c.abs()).max() == Some(ring)), "{ring}");
            let expected = if ring == 0 { 1 } else { (2 * ring + 1).pow(3) - (2 * ring - 1).pow(3) };
            assert_eq!(cells.len(), expected as usize, "{ring}");
        }
    }
}
