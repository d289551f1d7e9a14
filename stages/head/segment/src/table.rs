//! The table of the clusters: moments, heights, where a cluster was cut off, and whether the face is in it.

use crate::plane::vector;
use nalgebra::{Matrix3, Vector3};

/// Where a cluster may not be whole.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Touch {
    /// It reaches the edge of the image.
    ImageEdge,
    /// It reaches the greatest height.
    Ceiling,
    /// It reaches the edge of the hull.
    HullEdge,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClusterRow {
    pub voxels: u32,
    /// Mean of its voxels in metres.
    pub centroid: Vector3<f64>,
    /// Standard deviations along its principal axes in metres, falling.
    pub spread: Vector3<f64>,
    /// Heights over the plane of its lowest and its highest voxel in metres.
    pub heights: [f64; 2],
    /// It reaches the edge of the image, the greatest height, the edge of the hull.
    pub touches: [bool; 3],
    /// Voxels of it that are the face's; 0 where the face is elsewhere.
    pub face_voxels: u32,
}

/// Sums over one cluster's voxels, about its first one.
#[derive(Debug, Clone, Copy)]
struct Sums {
    origin: Vector3<f64>,
    sum: Vector3<f64>,
    products: Matrix3<f64>,
}

/// The rows with their buffers; after the first frames they allocate nothing.
#[derive(Debug, Clone, Default)]
pub struct ClusterRows {
    rows: Vec<ClusterRow>,
    sums: Vec<Sums>,
}

impl ClusterRows {
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// The rows, in the order of the clusters' numbers.
    #[must_use]
    pub fn rows(&self) -> &[ClusterRow] {
        &self.rows
    }

    /// Forgets all rows and keeps the memory.
    pub fn clear(&mut self) {
        self.rows.clear();
    }

    /// Starts rows for `clusters` clusters without voxels.
    pub fn start(&mut self, clusters: usize) {
        let row = ClusterRow {
            voxels: 0,
            centroid: Vector3::zeros(),
            spread: Vector3::zeros(),
            heights: [f64::INFINITY, f64::NEG_INFINITY],
            touches: [false; 3],
            face_voxels: 0,
        };
        self.rows.clear();
        self.rows.resize(clusters, row);
        self.sums.clear();
        let nothing = Sums { origin: Vector3::zeros(), sum: Vector3::zeros(), products: Matrix3::zeros() };
        self.sums.resize(clusters, nothing);
    }

    /// Adds a voxel at a height over the plane (metres) to a cluster; a number that is no cluster's adds nothing.
    pub fn add(&mut self, cluster: u32, voxel: [f32; 3], height: f64) {
        let Some((row, sums)) = self.rows.get_mut(cluster as usize).zip(self.sums.get_mut(cluster as usize))
        else {
            return;
        };
        let point = vector(voxel);
        if row.voxels == 0 {
            sums.origin = point;
        }
        let d = point - sums.origin;
        sums.sum += d;
        sums.products += d * d.transpose();
        row.voxels += 1;
        row.heights = [row.heights[0].min(height), row.heights[1].max(height)];
    }

    /// Says where a cluster was cut off.
    pub fn touch(&mut self, cluster: u32, what: Touch) {
        if let Some(row) = self.rows.get_mut(cluster as usize) {
            row.touches[what as usize] = true;
        }
    }

    /// Turns the sums into centroids and spreads.
    pub fn finish(&mut self) {
        for (row, sums) in self.rows.iter_mut().zip(&self.sums).filter(|(row, _)| row.voxels > 0) {
            let count = f64::from(row.voxels);
            let mean = sums.sum / count;
            row.centroid = sums.origin + mean;
            let covariance = sums.products / count - mean * mean.transpose();
            let mut variances: [f64; 3] = covariance.symmetric_eigenvalues().into();
            variances.sort_by(|a, b| b.total_cmp(a));
            row.spread = variances.map(|v| v.max(0.0).sqrt()).into();
        }
    }

    /// Says that a voxel of a cluster is the face's.
    pub fn add_face(&mut self, cluster: u32) {
        if let Some(row) = self.rows.get_mut(cluster as usize) {
            row.face_voxels += 1;
        }
    }

    /// The cluster with the most voxels of the face, the first of equals.
    #[must_use]
    pub fn chosen(rows: &[ClusterRow]) -> Option<usize> {
        let most = rows.iter().map(|row| row.face_voxels).max().filter(|&most| most > 0)?;
        rows.iter().position(|row| row.face_voxels == most)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_says_where_its_cluster_is_and_how_far_it_spreads() {
        let mut table = ClusterRows::new();
        table.start(2);
        for i in 0..5 {
            let along = i as f32 * 0.1;
            table.add(1, [1.0 + along, 2.0, 3.0 + 2.0 * along], f64::from(along));
        }
        table.add(7, [9.0; 3], 9.0);
        table.touch(1, Touch::Ceiling);
        table.touch(7, Touch::ImageEdge);
        table.finish();
        for _ in 0..4 {
            table.add_face(1);
        }
        table.add_face(7);
        assert_eq!(ClusterRows::chosen(table.rows()), Some(1));
        assert_eq!(ClusterRows::chosen(&table.rows()[..1]), None);
        let [none, row] = table.rows() else { unreachable!("two rows were started") };
        assert_eq!(none.voxels, 0);
        assert!((row.centroid - Vector3::new(1.2, 2.0, 3.4)).norm() < 1e-6);
        // Five steps of 0.1 sqrt(5), whose deviation is sqrt(2) steps.
        assert!((row.spread - Vector3::new(0.1 * 10.0_f64.sqrt(), 0.0, 0.0)).norm() < 1e-6, "{}", row.spread);
        assert_eq!((row.voxels, row.face_voxels, row.touches), (5, 4, [false, true, false]));
        assert!(row.heights[0] == 0.0 && (row.heights[1] - 0.4).abs() < 1e-6);
    }
}
