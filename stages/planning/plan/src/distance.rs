//! How far each voxel of a grid is from a set of voxels.

use stillpoint_patient::Grid;

/// Distance from the centre of each voxel to the nearest centre of a voxel of the set, mm; infinite where the set is empty.
///
/// Exact and separable: the lower envelope of parabolas along each axis (Felzenszwalb and Huttenlocher, Theory of
/// Computing 8 (2012) 415).
pub fn distances_mm(grid: &Grid, set: impl Fn(usize) -> bool) -> Vec<f32> {
    let mut squares: Vec<f32> = (0..grid.len()).map(|i| if set(i) { 0.0 } else { f32::INFINITY }).collect();
    let mut stride = 1;
    for axis in 0..3 {
        let count = grid.counts[axis];
        let mut line = GridLine::new(count, grid.spacing_mm[axis]);
        for start in (0..grid.len()).filter(|i| i / stride % count == 0) {
            line.transform(&mut squares, start, stride);
        }
        stride *= count;
    }
    squares.iter_mut().for_each(|square| *square = square.sqrt());
    squares
}

/// Distance from the centre of each voxel to the nearest voxel of air, mm. Where the image ends there is no skin: a voxel
/// beyond it is no air.
pub fn depths_mm(grid: &Grid, image: &Grid, in_patient: impl Fn(usize) -> bool) -> Vec<f32> {
    let seen = |voxel: usize| {
        let centre = grid.centre_mm(grid.voxel(voxel));
        (0..3).all(|axis| {
            let place = (centre[axis] - image.origin_mm[axis]) / image.spacing_mm[axis];
            (-0.5..=image.counts[axis] as f64 - 0.5).contains(&place)
        })
    };
    distances_mm(grid, |voxel| !in_patient(voxel) && seen(voxel))
}

/// Room for the transform of one line of voxels.
struct GridLine {
    spacing_mm: f64,
    values: Vec<f64>,
    /// Voxels whose parabolas form the envelope.
    roots: Vec<usize>,
    /// Where each begins to be the lowest, in voxels.
    begins: Vec<f64>,
}

impl GridLine {
    fn new(count: usize, spacing_mm: f64) -> Self {
        Self { spacing_mm, values: vec![0.0; count], roots: Vec::new(), begins: Vec::new() }
    }

    fn transform(&mut self, squares: &mut [f32], start: usize, stride: usize) {
        let at = |i: usize| start + i * stride;
        // In units of the squared spacing.
        let unit = self.spacing_mm * self.spacing_mm;
        self.roots.clear();
        self.begins.clear();
        for i in 0..self.values.len() {
            let value = f64::from(squares[at(i)]) / unit;
            self.values[i] = value;
            if value == f64::INFINITY {
                continue;
            }
            let mut begin = f64::NEG_INFINITY;
            while let (Some(&root), Some(&previous)) = (self.roots.last(), self.begins.last()) {
                let (a, b) = (root as f64, i as f64);
                begin = ((value + b * b) - (self.values[root] + a * a)) / (2.0 * (b - a));
                if begin > previous {
                    break;
                }
                self.roots.pop();
                self.begins.pop();
                begin = f64::NEG_INFINITY;
            }
            self.roots.push(i);
            self.begins.push(begin);
        }
        let mut lowest = 0;
        for i in 0..self.values.len() {
            while self.begins.get(lowest + 1).is_some_and(|begin| *begin <= i as f64) {
                lowest += 1;
            }
            if let Some(&root) = self.roots.get(lowest) {
                let offset = i as f64 - root as f64;
                squares[at(i)] = ((self.values[root] + offset * offset) * unit) as f32;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn distances_are_those_of_a_search_over_all_voxels(
            counts in prop::array::uniform3(1_usize..6), spacing_mm in prop::array::uniform3(0.5..4.0_f64),
            set in prop::collection::vec(prop::bool::weighted(0.1), 216),
        ) {
            let grid = Grid { counts, spacing_mm, origin_mm: [0.0; 3] };
            let found = distances_mm(&grid, |i| set[i]);
            for (i, found) in found.iter().enumerate() {
                let here = grid.centre_mm(grid.voxel(i));
                let nearest = (0..grid.len()).filter(|j| set[*j]).map(|j| {
                    let there = grid.centre_mm(grid.voxel(j));
                    (0..3).map(|k| (here[k] - there[k]).powi(2)).sum::<f64>().sqrt()
                });
                let nearest = nearest.fold(f64::INFINITY, f64::min);
                prop_assert!(
                    f64::from(*found) == nearest || (f64::from(*found) - nearest).abs() < 1e-4 * nearest,
                    "{i}: {found} {nearest}"
                );
            }
        }
    }
}
