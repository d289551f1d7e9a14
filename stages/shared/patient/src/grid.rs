//! Where the voxels of a volume are.

/// A regular grid along the axes of the DICOM patient frame: x to the patient's left, y to the back, z to the head.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Voxels along x, y, z.
    pub counts: [usize; 3],
    /// Distance between voxel centres along x, y, z, mm.
    pub spacing_mm: [f64; 3],
    /// Centre of the first voxel, mm.
    pub origin_mm: [f64; 3],
}

impl Grid {
    /// Number of voxels.
    pub fn len(&self) -> usize {
        self.counts.iter().product()
    }

    /// Whether there is no voxel.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Volume of a voxel, cm3.
    pub fn voxel_cm3(&self) -> f64 {
        self.spacing_mm.iter().product::<f64>() * 1e-3
    }

    /// Place of a voxel in a volume's values: x runs fastest, z slowest.
    pub fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        x + self.counts[0] * (y + self.counts[1] * z)
    }

    /// The voxel at this place of a volume's values.
    pub fn voxel(&self, index: usize) -> [usize; 3] {
        let [nx, ny, _] = self.counts;
        [index % nx, index / nx % ny, index / (nx * ny)]
    }

    /// The value at a place (mm), linear between the centres of voxels; 0 outside the outermost centres' cells.
    pub fn value_at(&self, values: &[f32], at_mm: [f64; 3]) -> f32 {
        let mut low = [0; 3];
        let mut part = [0.0; 3];
        for axis in 0..3 {
            let place = (at_mm[axis] - self.origin_mm[axis]) / self.spacing_mm[axis];
            let last = self.counts[axis] as f64 - 1.0;
            if !(-0.5..=last + 0.5).contains(&place) {
                return 0.0;
            }
            let place = place.clamp(0.0, last);
            low[axis] = place as usize;
            part[axis] = (place - place.floor()) as f32;
        }
        let next: [usize; 3] = std::array::from_fn(|axis| (low[axis] + 1).min(self.counts[axis] - 1));
        let at = |x, y, z| values.get(self.index([x, y, z])).copied().unwrap_or_default();
        let along_x = |y, z| at(low[0], y, z) * (1.0 - part[0]) + at(next[0], y, z) * part[0];
        let along_y = |z| along_x(low[1], z) * (1.0 - part[1]) + along_x(next[1], z) * part[1];
        along_y(low[2]) * (1.0 - part[2]) + along_y(next[2]) * part[2]
    }

    /// Centre of a voxel, mm.
    pub fn centre_mm(&self, voxel: [usize; 3]) -> [f64; 3] {
        std::array::from_fn(|axis| self.origin_mm[axis] + voxel[axis] as f64 * self.spacing_mm[axis])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn index_and_voxel_are_inverse_with_x_fastest() {
        let grid = Grid { counts: [3, 4, 5], spacing_mm: [1.0, 2.0, 3.0], origin_mm: [-1.0, 0.0, 10.0] };
        assert_eq!((grid.index([1, 0, 0]), grid.index([0, 1, 0]), grid.index([0, 0, 1])), (1, 3, 12));
        assert!((0..grid.len()).all(|i| grid.index(grid.voxel(i)) == i));
        assert_eq!(grid.centre_mm([2, 1, 1]), [1.0, 2.0, 13.0]);
    }

    #[test]
    fn values_are_linear_between_centres_and_nothing_outside() {
        let grid = Grid { counts: [3, 2, 2], spacing_mm: [1.0, 2.0, 3.0], origin_mm: [-1.0, 0.0, 10.0] };
        let linear = |[x, y, z]: [f64; 3]| (3.0 * x - y + 0.5 * z) as f32;
        let values: Vec<f32> = (0..12).map(|i| linear(grid.centre_mm(grid.voxel(i)))).collect();
        for at in [[-0.25, 0.5, 11.0], [1.0, 2.0, 13.0], [-1.0, 0.0, 10.0]] {
            assert!((grid.value_at(&values, at) - linear(at)).abs() < 1e-5, "{at:?}");
        }
        assert_eq!(grid.value_at(&values, [1.4, 0.0, 10.0]), linear([1.0, 0.0, 10.0]), "within its voxel");
        assert_eq!(grid.value_at(&values, [1.6, 0.0, 10.0]), 0.0);
    }
}
