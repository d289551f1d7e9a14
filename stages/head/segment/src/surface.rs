//! The surface that voxels lie on, in patches: where each is, which way it faces, how it bends, what it borders on.
//!
//! A patch is what lies in a cell a few voxels wide. Its normal is that of the plane through all voxels in it and in
//! the cells around it; its bend is how far these lie on average before the patch along that normal: positive in a
//! crease, negative on a ridge.

use crate::cell_index::CellIndex;
use crate::cells::CellKey;
use crate::plane::vector;
use crate::sweep::Sweep;
use nalgebra::{Matrix3, Vector3};

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Patch {
    /// Mean of its voxels in metres.
    pub place: Vector3<f64>,
    /// Unit normal, toward the origin.
    pub normal: Vector3<f64>,
    /// How far the surroundings lie before it along the normal, in metres.
    pub bend: f64,
    pub voxels: u32,
}

/// Sums over the voxels of a cell, about a point common to all cells.
#[derive(Debug, Clone, Copy, Default)]
struct Moments {
    count: f64,
    sum: Vector3<f64>,
    products: [f64; 6],
}

impl Moments {
    fn add_point(&mut self, d: Vector3<f64>) {
        self.count += 1.0;
        self.sum += d;
        let products = [d.x * d.x, d.x * d.y, d.x * d.z, d.y * d.y, d.y * d.z, d.z * d.z];
        for (sum, product) in self.products.iter_mut().zip(products) {
            *sum += product;
        }
    }

    fn add(&mut self, other: &Self) {
        self.count += other.count;
        self.sum += other.sum;
        for (sum, product) in self.products.iter_mut().zip(other.products) {
            *sum += product;
        }
    }

    fn mean(&self) -> Vector3<f64> {
        self.sum / self.count
    }

    fn covariance(&self) -> Matrix3<f64> {
        let [xx, xy, xz, yy, yz, zz] = self.products;
        let mean = self.mean();
        Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz) / self.count - mean * mean.transpose()
    }
}

/// The patches with their buffers; after the first frames of a size they allocate nothing.
#[derive(Debug, Clone, Default)]
pub struct Surface {
    index: CellIndex,
    patch_of_voxel: Vec<u32>,
    moments: Vec<Moments>,
    patches: Vec<Patch>,
    borders: Vec<[u32; 2]>,
    sweep: Sweep,
    around: Vec<Moments>,
}

impl Surface {
    /// Gathers `voxels` (metres) into patches `side` metres wide.
    pub fn gather(&mut self, voxels: &[[f32; 3]], side: f64) {
        self.index.clear();
        self.patch_of_voxel.clear();
        self.moments.clear();
        self.patches.clear();
        self.borders.clear();
        let origin = voxels.first().map_or_else(Vector3::zeros, |&first| vector(first));
        for &voxel in voxels {
            // Voxels are cells of a grid of their own, so none is beyond this one.
            let patch = CellKey::of(voxel, 1.0 / side).map_or(0, |key| self.index.insert(key));
            if patch as usize >= self.moments.len() {
                self.moments.push(Moments::default());
            }
            self.moments[patch as usize].add_point(vector(voxel) - origin);
            self.patch_of_voxel.push(patch);
        }
        self.around.clear();
        self.around.extend_from_slice(&self.moments);
        let (moments, around, borders) = (&self.moments, &mut self.around, &mut self.borders);
        self.sweep.pairs(self.index.keys(), 1, |a, b| {
            borders.push([a, b]);
            around[a as usize].add(&moments[b as usize]);
            around[b as usize].add(&moments[a as usize]);
        });
        self.patches.extend(self.moments.iter().zip(&self.around).map(|(own, around)| {
            let place = own.mean();
            let normal = thinnest(&around.covariance());
            let normal = if normal.dot(&(place + origin)) > 0.0 { -normal } else { normal };
            let bend = normal.dot(&(around.mean() - place));
            Patch { place: place + origin, normal, bend, voxels: own.count as u32 }
        }));
    }

    /// The patches, in the order in which the voxels first enter them.
    #[must_use]
    pub fn patches(&self) -> &[Patch] {
        &self.patches
    }

    /// Pairs of patches in neighbouring cells, each pair once.
    #[must_use]
    pub fn borders(&self) -> &[[u32; 2]] {
        &self.borders
    }

    /// Whether two patches are in neighbouring cells, or one.
    #[must_use]
    pub fn are_neighbours(&self, a: u32, b: u32) -> bool {
        self.index.keys()[a as usize].touches(self.index.keys()[b as usize])
    }

    /// For each voxel its patch.
    #[must_use]
    pub fn patch_of_voxel(&self) -> &[u32] {
        &self.patch_of_voxel
    }
}

/// The unit eigenvector of the least eigenvalue of a covariance, in closed form (Smith 1961).
fn thinnest(c: &Matrix3<f64>) -> Vector3<f64> {
    let mean = c.trace() / 3.0;
    let shifted = c - Matrix3::from_diagonal_element(mean);
    let p = (shifted.norm_squared() / 6.0).sqrt();
    if !(p > 0.0 && p.is_finite()) {
        return Vector3::z();
    }
    let half_determinant = (shifted / p).determinant() / 2.0;
    let angle = libm::acos(half_determinant.clamp(-1.0, 1.0)) / 3.0;
    let least = mean + 2.0 * p * libm::cos(angle + 2.0 * std::f64::consts::FRAC_PI_3);
    // The rows of C - least I are across the eigenvector; the longest cross product of two of them is along it.
    let m = c - Matrix3::from_diagonal_element(least);
    let rows = [m.row(0).transpose(), m.row(1).transpose(), m.row(2).transpose()];
    let mut best = Vector3::zeros();
    for (a, b) in [(0, 1), (1, 2), (2, 0)] {
        let cross = rows[a].cross(&rows[b]);
        if cross.norm_squared() > best.norm_squared() {
            best = cross;
        }
    }
    let length = best.norm();
    if length > 0.0 { best / length } else { Vector3::z() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn closed_form_agrees_with_the_iterated_eigenvector(
            points in prop::collection::vec(prop::array::uniform3(-1.0..1.0_f64), 4..30),
            flat in 0.05..0.5_f64,
        ) {
            let mut moments = Moments::default();
            for [x, y, z] in points {
                moments.add_point(Vector3::new(x, y + 0.3 * x, flat * z + 0.5 * x));
            }
            let covariance = moments.covariance();
            let eigen = covariance.symmetric_eigen();
            let least = eigen.eigenvalues.imin();
            let mut sorted: Vec<f64> = eigen.eigenvalues.iter().copied().collect();
            sorted.sort_by(f64::total_cmp);
            // Where two are nearly the same, any direction between is right.
            prop_assume!(sorted[1] - sorted[0] > 1e-3 * sorted[2]);
            let cosine = thinnest(&covariance).dot(&eigen.eigenvectors.column(least)).abs();
            prop_assert!(cosine > 1.0 - 1e-6, "{cosine}");
        }
    }

    /// A floor and a wall that meet, 1 m before the camera, in voxels of 5 mm.
    fn corner() -> Vec<[f32; 3]> {
        let mut voxels = Vec::new();
        for i in 0..40 {
            for j in 0..40 {
                let (a, b) = (i as f32 * 0.005, j as f32 * 0.005);
                voxels.push([a, 0.2 - b, 1.0]);
                voxels.push([a, 0.2, 1.0 - b]);
            }
        }
        voxels
    }

    #[test]
    fn patches_face_the_camera_and_bend_in_a_crease_only() {
        let mut surface = Surface::default();
        surface.gather(&corner(), 0.01);
        for patch in surface.patches() {
            let from_crease = (0.2 - patch.place.y).max(1.0 - patch.place.z);
            let inside = patch.place.x > 0.015 && patch.place.x < 0.18 && from_crease < 0.17;
            if inside && from_crease > 0.03 {
                let facing = if patch.place.z > 0.99 { -Vector3::z() } else { -Vector3::y() };
                assert!(patch.normal.dot(&facing) > 0.999, "{patch:?}");
                assert!(patch.bend.abs() < 1e-3, "{patch:?}");
            } else if inside && from_crease < 0.006 {
                assert!(patch.bend > 1.2e-3, "{patch:?}");
            }
        }
        assert_eq!(surface.patch_of_voxel().len(), corner().len());
    }

    #[test]
    fn second_frame_remembers_nothing_of_the_first() {
        let (mut used, mut fresh) = (Surface::default(), Surface::default());
        used.gather(&corner(), 0.01);
        for surface in [&mut used, &mut fresh] {
            surface.gather(&corner()[..700], 0.012);
        }
        assert_eq!((used.patches(), used.borders()), (fresh.patches(), fresh.borders()));
    }

    #[test]
    fn no_voxels_have_no_patches() {
        let mut surface = Surface::default();
        surface.gather(&[], 0.01);
        assert!(surface.patches().is_empty() && surface.borders().is_empty());
    }
}
