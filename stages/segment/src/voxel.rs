//! Voxel grid: one centroid for the points of each cubic cell.

use crate::cells::{CellIndex, CellKey};
use crate::cloud::Cloud;

/// Marks a point that fell into no cell.
pub const NO_VOXEL: u32 = u32::MAX;

/// Sums over the points of a voxel.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    x: f64,
    y: f64,
    z: f64,
    count: u32,
}

impl Sums {
    /// Adds a run of points to the sums of a voxel: of one that is there, or of the next one.
    fn add_to(&self, voxels: &mut Vec<Self>, voxel: u32) {
        if self.count == 0 {
            return;
        }
        match voxels.get_mut(voxel as usize) {
            Some(sums) => {
                sums.x += self.x;
                sums.y += self.y;
                sums.z += self.z;
                sums.count += self.count;
            }
            None => voxels.push(*self),
        }
    }
}

/// A voxel grid with its buffers; after the first frames of a size, [`downsample`](Self::downsample) allocates nothing.
#[derive(Debug, Clone, Default)]
pub struct VoxelGrid {
    index: CellIndex,
    voxels: Vec<Sums>,
    counts: Vec<u32>,
    centroids: Vec<[f32; 3]>,
    voxel_of_point: Vec<u32>,
    renumbered: Vec<u32>,
}

impl VoxelGrid {
    /// An empty grid.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Gathers the points of `cloud` that lie within `range_max` metres of the origin into cells `leaf` metres wide.
    ///
    /// Voxels are in the order in which the cloud first enters them. Points that are not finite, too far away or
    /// 2^20 cells from the origin are in none.
    pub fn downsample(&mut self, cloud: Cloud<'_>, leaf: f64, range_max: f64) {
        let Self { index, voxels, voxel_of_point, .. } = self;
        index.clear();
        voxels.clear();
        voxel_of_point.clear();
        voxel_of_point.resize(cloud.points.len(), NO_VOXEL);
        let inverse_leaf = 1.0 / leaf;
        let range_squared = (range_max * range_max) as f32;
        // Neighbouring pixels mostly share a cell: sums over such a run stay at hand until it ends.
        let (mut last, mut last_key, mut run) = (NO_VOXEL, None, Sums::default());
        let (mut before, mut before_key) = (NO_VOXEL, None);
        for (place, &point) in cloud.points.iter().enumerate() {
            let [x, y, z] = point;
            // Not within range, written so that NaN is outside.
            let within = x * x + y * y + z * z <= range_squared;
            let key = if within { CellKey::of(point, inverse_leaf) } else { None };
            let Some(found) = key else { continue };
            if key != last_key {
                run.add_to(voxels, last);
                run = Sums::default();
                // Noise goes to and fro between two cells; else the pixel above is the most likely to share one.
                let above = || place.checked_sub(cloud.width).and_then(|above| voxel_of_point.get(above));
                let voxel = if key == before_key {
                    before
                } else {
                    match above() {
                        Some(&above) if index.keys().get(above as usize) == Some(&found) => above,
                        _ => index.insert(found),
                    }
                };
                (before, before_key) = (last, last_key);
                last = voxel;
                last_key = key;
            }
            voxel_of_point[place] = last;
            run.x += f64::from(x);
            run.y += f64::from(y);
            run.z += f64::from(z);
            run.count += 1;
        }
        run.add_to(voxels, last);
        self.centroids.clear();
        self.counts.clear();
        for sums in &self.voxels {
            let inverse = 1.0 / f64::from(sums.count);
            self.centroids.push([sums.x, sums.y, sums.z].map(|s| (s * inverse) as f32));
            self.counts.push(sums.count);
        }
    }

    /// Removes the voxels that are not to be kept, one answer for each; their points are then in none.
    pub fn retain(&mut self, keep: &[bool]) {
        self.renumbered.clear();
        let mut kept = 0;
        for (voxel, _) in self.centroids.iter().enumerate() {
            let stays = keep.get(voxel) == Some(&true);
            self.renumbered.push(if stays { kept } else { NO_VOXEL });
            kept += u32::from(stays);
        }
        for (voxel, &number) in self.renumbered.iter().enumerate().filter(|(_, number)| **number != NO_VOXEL)
        {
            self.centroids[number as usize] = self.centroids[voxel];
            self.counts[number as usize] = self.counts[voxel];
        }
        self.centroids.truncate(kept as usize);
        self.counts.truncate(kept as usize);
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
