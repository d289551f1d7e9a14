//! Which patches are seen beside each other.

use crate::cloud::Cloud;
use crate::voxel::NO_VOXEL;

/// Pixels that were not measured between two that count as beside each other, at most.
const BLIND: u32 = 12;
/// Step between the rows and columns that are used.
const STRIDE: usize = 2;

/// Where a walk along a row or a column of the image is.
#[derive(Debug, Clone, Copy)]
struct Walk {
    /// The last pixel's patch, or [`NO_VOXEL`] where it is in none.
    last: u32,
    /// Pixels since that were not measured.
    blind: u32,
}

impl Walk {
    const START: Self = Self { last: NO_VOXEL, blind: 0 };

    /// The next pixel. `patch` is `None` where it was not measured.
    #[inline]
    fn step(&mut self, patch: Option<u32>, pairs: &mut Vec<[u32; 2]>) {
        let Some(patch) = patch else {
            self.blind += 1;
            return;
        };
        if self.last != patch && self.last != NO_VOXEL && patch != NO_VOXEL && self.blind <= BLIND {
            pairs.push([self.last, patch]);
        }
        *self = Self { last: patch, blind: 0 };
    }
}

/// Finds pairs of patches that are seen beside each other; after the first frames of a size it allocates nothing.
#[derive(Debug, Clone, Default)]
pub(super) struct PairsSeen {
    columns: Vec<Walk>,
    pairs: Vec<[u32; 2]>,
}

impl PairsSeen {
    /// Pairs of patches that are neighbours in every second row and column of the cloud's image; a pair is listed as
    /// often as it is seen. `patch_of_voxel` is [`NO_VOXEL`] for a voxel without a patch.
    pub fn find(&mut self, cloud: Cloud<'_>, voxel_of_point: &[u32], patch_of_voxel: &[u32]) -> &[[u32; 2]] {
        self.pairs.clear();
        if cloud.width == 0 {
            return &self.pairs;
        }
        self.columns.clear();
        self.columns.resize(cloud.width.div_ceil(STRIDE), Walk::START);
        let patch = |voxel: u32| patch_of_voxel.get(voxel as usize).copied();
        // Row by row, as the image lies in memory, with the walks down the columns side by side.
        for (v, row) in voxel_of_point.chunks_exact(cloud.width).enumerate() {
            if v % STRIDE == 0 {
                let mut walk = Walk::START;
                row.iter().for_each(|&voxel| walk.step(patch(voxel), &mut self.pairs));
            }
            for (walk, &voxel) in self.columns.iter_mut().zip(row.iter().step_by(STRIDE)) {
                walk.step(patch(voxel), &mut self.pairs);
            }
        }
        &self.pairs
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_are_of_neighbours_in_rows_and_columns() {
        // Voxels 0 to 3; 2 is of no interest, and one pixel was not measured.
        let voxels = [0, 0, 1, NO_VOXEL, 3, 9, 9, 9, 9, 9, 2, 1, 0, 3, 1];
        let points = [[0.0; 3]; 15];
        let cloud = Cloud { points: &points, width: 5 };
        let mut seen = PairsSeen::default();
        let voxels = voxels.map(|v| if v == 9 { NO_VOXEL } else { v });
        let places = [10, 11, NO_VOXEL, 13];
        let mut pairs = seen.find(cloud, &voxels, &places).to_vec();
        pairs.sort_unstable();
        // Rows 0 and 2, then columns 0, 2 and 4, over the unmeasured row.
        assert_eq!(pairs, [[10, 11], [10, 13], [11, 10], [11, 10], [11, 13], [13, 11], [13, 11]]);
        assert!(seen.find(Cloud::unorganised(&points), &voxels, &places).is_empty());
    }

    #[test]
    fn what_a_wide_gap_parts_is_no_pair() {
        let row = |gap: usize| {
            let mut voxels = vec![0];
            voxels.extend(vec![NO_VOXEL; gap]);
            voxels.push(1);
            let points = vec![[0.0; 3]; voxels.len()];
            let cloud = Cloud { points: &points, width: voxels.len() };
            PairsSeen::default().find(cloud, &voxels, &[0, 1]).len()
        };
        assert_eq!((row(BLIND as usize), row(BLIND as usize + 1)), (1, 0));
    }
}
