//! Voxel grid: one centroid for the points of each cubic cell.

use crate::cell_index::CellIndex;
use crate::cells::CellKey;
use crate::cloud::Cloud;

/// Marks a point that fell into no cell.
pub const NO_VOXEL: u32 = u32::MAX;

/// Points that are processed together.
const PIECE: usize = 128;

/// Sums over the points of a voxel: x, y, z, and how many they are.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Sums([f64; 4]);

/// A voxel grid with its buffers; after the first frames of a size, [`downsample`](Self::downsample) allocates nothing.
#[derive(Debug, Clone, Default)]
pub struct VoxelGrid {
    index: CellIndex,
    voxels: Vec<Sums>,
    /// The same of the cloud before.
    before: Vec<Sums>,
    counts: Vec<u32>,
    centroids: Vec<[f32; 3]>,
    voxel_of_point: Vec<u32>,
    renumbered: Vec<u32>,
}

impl VoxelGrid {
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Gathers the points of `cloud` that lie within `range_max` metres of the origin into cells `leaf` metres wide.
    ///
    /// Voxels are in the order in which the cloud first enters them. Points that are not finite, too far away or
    /// 2^20 cells from the origin are in none.
    pub fn downsample(&mut self, cloud: Cloud<'_>, leaf: f64, range_max: f64) {
        let Self { index, voxels, before, voxel_of_point, .. } = self;
        index.clear();
        std::mem::swap(voxels, before);
        voxels.clear();
        voxel_of_point.clear();
        let inverse_leaf = 1.0 / leaf;
        // Beyond this the grid may end.
        let range = range_max.min(CellKey::INNER * leaf);
        let range_squared = ((range * range) as f32).min(f32::MAX);
        // In pieces and in three passes over each, so that a wrong guess of the processor in one does not hold up another.
        let mut keys = [CellKey::NONE; PIECE];
        for points in cloud.points.chunks(PIECE) {
            for (key, &point) in keys.iter_mut().zip(points) {
                let [x, y, z] = point;
                let found = CellKey::of_inner(point, inverse_leaf);
                // Written so that NaN is outside.
                *key = if x * x + y * y + z * z <= range_squared { found } else { CellKey::NONE };
            }
            let first = voxel_of_point.len();
            for &key in &keys[..points.len()] {
                voxel_of_point.push(if key == CellKey::NONE { NO_VOXEL } else { index.insert(key) });
            }
            voxels.resize(index.len(), Sums::default());
            for (&voxel, &[x, y, z]) in voxel_of_point[first..].iter().zip(points) {
                if let Some(sums) = voxels.get_mut(voxel as usize) {
                    let point = [f64::from(x), f64::from(y), f64::from(z), 1.0];
                    sums.0.iter_mut().zip(point).for_each(|(sum, value)| *sum += value);
                }
            }
        }
        self.centroids.clear();
        self.counts.clear();
        for sums in &self.voxels {
            let [x, y, z, count] = sums.0;
            let inverse = 1.0 / count;
            self.centroids.push([x, y, z].map(|s| (s * inverse) as f32));
            self.counts.push(count as u32);
        }
    }

    /// Whether the last cloud gave the same voxels as the cloud before it, to the bit; with the noise of a working
    /// sensor two clouds never do. Only the clouds are compared, without removed or replaced voxels.
    #[must_use]
    pub fn is_repeated(&self) -> bool {
        self.voxels == self.before
    }

    /// Removes the voxels that are not to be kept, one answer for each; their points are then in none.
    pub fn retain(&mut self, keep: &[bool]) {
        self.renumbered.clear();
        let mut retained = 0;
        for (voxel, _) in self.centroids.iter().enumerate() {
            let stays = keep.get(voxel) == Some(&true);
            self.renumbered.push(if stays { retained } else { NO_VOXEL });
            retained += u32::from(stays);
        }
        for (voxel, &number) in self.renumbered.iter().enumerate().filter(|(_, number)| **number != NO_VOXEL)
        {
            self.centroids[number as usize] = self.centroids[voxel];
            self.counts[number as usize] = self.counts[voxel];
        }
        self.centroids.truncate(retained as usize);
        self.counts.truncate(retained as usize);
        for voxel in &mut self.voxel_of_point {
            *voxel = self.renumbered.get(*voxel as usize).copied().unwrap_or(NO_VOXEL);
        }
    }

    /// Puts other places where the centroids were, one for each voxel.
    ///
    /// # Panics
    /// Where there are more or fewer places than voxels.
    pub fn replace(&mut self, places: &[[f32; 3]]) {
        self.centroids.copy_from_slice(places);
    }

    /// Points that fell into a voxel.
    #[must_use]
    pub fn points(&self) -> usize {
        self.counts.iter().map(|&count| count as usize).sum()
    }

    /// The centroid of each voxel, in metres.
    #[must_use]
    pub fn centroids(&self) -> &[[f32; 3]] {
        &self.centroids
    }

    /// The number of points in each voxel.
    #[must_use]
    pub fn counts(&self) -> &[u32] {
        &self.counts
    }

    /// For each point of the cloud its voxel, or [`NO_VOXEL`].
    #[must_use]
    pub fn voxel_of_point(&self) -> &[u32] {
        &self.voxel_of_point
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NAN: [f32; 3] = [f32::NAN; 3];

    #[test]
    fn points_of_a_cell_become_their_centroid_in_order_of_first_sight() {
        let mut grid = VoxelGrid::new();
        let cloud = [[0.25, 0.0, 1.0], NAN, [0.01, 0.02, 1.0], [0.03, 0.04, 1.0], [0.27, 0.02, 1.02]];
        grid.downsample(Cloud::unorganised(&cloud), 0.1, 10.0);
        assert_eq!(grid.voxel_of_point(), [0, NO_VOXEL, 1, 1, 0]);
        assert_eq!(grid.counts(), [2, 2]);
        assert_eq!(grid.centroids(), [[0.26, 0.01, 1.01], [0.02, 0.03, 1.0]]);
    }

    #[test]
    fn points_beyond_the_range_are_in_no_voxel() {
        let mut grid = VoxelGrid::new();
        grid.downsample(Cloud::unorganised(&[[0.0, 0.0, 1.0], [1.0, 1.0, 1.0]]), 0.1, 1.5);
        assert_eq!(grid.voxel_of_point(), [0, NO_VOXEL]);
    }

    #[test]
    fn removed_voxels_leave_their_points_in_none() {
        let mut grid = VoxelGrid::new();
        let cloud = [[0.0, 0.0, 1.0], [0.2, 0.0, 1.0], NAN, [0.4, 0.0, 1.0], [0.21, 0.0, 1.0]];
        grid.downsample(Cloud::unorganised(&cloud), 0.1, 10.0);
        grid.retain(&[false, true, true]);
        assert_eq!(grid.voxel_of_point(), [NO_VOXEL, 0, NO_VOXEL, 1, 0]);
        assert_eq!((grid.counts(), grid.points()), (&[2, 1][..], 3));
        assert_eq!(grid.centroids(), [[0.205, 0.0, 1.0], [0.4, 0.0, 1.0]]);
        grid.replace(&[[0.2, 0.0, 1.0], [0.4, 0.0, 0.9]]);
        assert_eq!(grid.centroids()[1], [0.4, 0.0, 0.9]);
    }

    #[test]
    fn same_cloud_again_is_noticed_whatever_became_of_its_voxels() {
        let mut grid = VoxelGrid::new();
        let cloud = [[0.0, 0.0, 1.0], [0.2, 0.0, 1.0], NAN];
        let mut next = cloud;
        next[1][2] = next[1][2].next_up();
        let mut is_repeated = |cloud: &[[f32; 3]]| {
            grid.downsample(Cloud::unorganised(cloud), 0.1, 10.0);
            let is_repeated = grid.is_repeated();
            grid.retain(&[false, true]);
            grid.replace(&[[0.3, 0.0, 1.0]]);
            is_repeated
        };
        let seen = [&cloud, &cloud, &next, &cloud, &cloud].map(|cloud| is_repeated(cloud));
        assert_eq!(seen, [false, true, false, false, true]);
    }

    #[test]
    fn second_frame_remembers_nothing_of_the_first() {
        let (mut used, mut fresh) = (VoxelGrid::new(), VoxelGrid::new());
        let frame: Vec<_> = (0..9000).map(|i| [i as f32 * 0.001, 0.0, 1.0]).collect();
        used.downsample(Cloud::unorganised(&frame), 0.002, 20.0);
        for grid in [&mut used, &mut fresh] {
            grid.downsample(Cloud::unorganised(&frame[..500]), 0.01, 20.0);
        }
        assert_eq!(used.centroids(), fresh.centroids());
        assert_eq!(used.voxel_of_point(), fresh.voxel_of_point());
    }
    #[test]
    fn a_grid_of_pixels_changes_nothing_but_the_time() {
        // A slanted surface with a hole, in rows of 40 pixels.
        let points: Vec<_> = (0..2000)
            .map(|i| {
                let (u, v) = ((i % 40) as f32 * 0.004, (i / 40) as f32 * 0.003);
                if i % 97 == 5 { NAN } else { [u, v, 1.0 + 0.7 * u - 0.3 * v] }
            })
            .collect();
        let (mut grid, mut unorganised) = (VoxelGrid::new(), VoxelGrid::new());
        grid.downsample(Cloud { points: &points, width: 40 }, 0.01, 2.0);
        unorganised.downsample(Cloud::unorganised(&points), 0.01, 2.0);
        assert_eq!(grid.voxel_of_point(), unorganised.voxel_of_point());
        assert_eq!(grid.centroids(), unorganised.centroids());
    }
}
