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

    /// Place of a voxel in a volume's values: x runs fastest, z slowest.
    pub fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        x + self.counts[0] * (y + self.counts[1] * z)
    }

    /// The voxel at this place of a volume's values.
    pub fn voxel(&self, index: usize) -> [usize; 3] {
        let [nx, ny, _] = self.counts;
        [index % nx, index / nx % ny, index / (nx * ny)]
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
}
