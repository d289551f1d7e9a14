//! The plane that supports the head, with the heights over it and the hull of what lies on it.

use super::params::FaceParams;
use crate::hull::ConvexHull;
use crate::mlesac::{Beneath, Mlesac, MlesacParams, PlaneFit};
use crate::plane::Plane;
use rand::Rng;

/// A plane with this part of its inliers' number beneath it, within its hull, supports nothing.
const BENEATH: f64 = 0.15;

/// A couch over a floor shows at least this part of what the floor shows, and is as level within this angle in radians.
const COUCH: f64 = 0.15;
const LEVEL: f64 = 0.3;

/// So many times more planes are drawn at most where no frame before had one.
const FIRST: u32 = 8;

/// The search with its buffers; after the first frames of a size it allocates nothing.
#[derive(Debug, Clone, Default)]
pub(super) struct Support {
    mlesac: Mlesac,
    /// The plane of the last frame that had one.
    prior: Option<Plane>,
    heights: Vec<f64>,
    hull: ConvexHull,
    /// What is higher than a head on the floor reaches.
    higher: Vec<[f32; 3]>,
}

impl Support {
    /// Forgets the frame, and keeps its plane to begin the next search with.
    pub fn clear(&mut self) {
        self.heights.clear();
        self.hull.clear();
    }

    /// For each voxel its height over the plane in metres.
    pub fn heights(&self) -> &[f64] {
        &self.heights
    }

    /// Outline of the plane's inliers.
    pub fn hull(&self) -> &ConvexHull {
        &self.hull
    }

    /// The plane that `voxels` (metres) are supported by.
    pub fn find(&mut self, voxels: &[[f32; 3]], params: &FaceParams, rng: &mut impl Rng) -> Option<PlaneFit> {
        let fit = self.find_lowest(voxels, params, rng)?;
        // A floor may be in range, and more of it in view than of the couch.
        Some(self.find_couch(voxels, params, &fit, rng).unwrap_or(fit))
    }

    /// Begins the next search with this plane.
    pub fn keep(&mut self, plane: Plane) {
        self.prior = Some(plane);
    }

    /// The plane that most voxels lie on and few beneath, with the heights over it and the hull of its inliers.
    fn find_lowest(
        &mut self,
        voxels: &[[f32; 3]],
        params: &FaceParams,
        rng: &mut impl Rng,
    ) -> Option<PlaneFit> {
        let fit = self.find_plane(voxels, params, Beneath::Outliers, rng)?;
        // A plane over the tops of pillows and shoulders may hold more voxels than what is left of the couch.
        if self.are_many_beneath(voxels, params, &fit) {
            return self.find_plane(voxels, params, Beneath::Unlikely, rng);
        }
        Some(fit)
    }

    /// The plane that most voxels lie on, with the heights over it and the hull of its inliers.
    fn find_plane(
        &mut self,
        voxels: &[[f32; 3]],
        params: &FaceParams,
        beneath: Beneath,
        rng: &mut impl Rng,
    ) -> Option<PlaneFit> {
        let FaceParams { plane_tolerance: tolerance, iterations, .. } = *params;
        // Where little of the couch is in view, few draws are of it alone; later frames begin with its plane.
        let iterations = if self.prior.is_some() { iterations } else { iterations.saturating_mul(FIRST) };
        let search = MlesacParams { tolerance, iterations, beneath };
        let fit = self.mlesac.find(voxels, self.prior.as_ref(), &search, rng)?;
        self.measure(voxels, tolerance, &fit);
        Some(fit)
    }

    /// The heights over a plane, and the hull of what lies on it.
    fn measure(&mut self, voxels: &[[f32; 3]], tolerance: f64, fit: &PlaneFit) {
        self.heights.clear();
        self.heights.extend(voxels.iter().map(|&voxel| fit.plane.height(voxel)));
        let on = voxels.iter().zip(&self.heights).filter(|(_, height)| height.abs() <= tolerance);
        self.hull.build(&fit.plane, on.map(|(&voxel, _)| voxel));
    }

    /// The couch over a floor: a level plane among what is higher over `floor` than a head on it reaches.
    fn find_couch(
        &mut self,
        voxels: &[[f32; 3]],
        params: &FaceParams,
        floor: &PlaneFit,
        rng: &mut impl Rng,
    ) -> Option<PlaneFit> {
        let FaceParams { plane_tolerance: tolerance, height_max, min_points, .. } = *params;
        let over = voxels.iter().zip(&self.heights).filter(|(_, height)| **height > height_max);
        self.higher.clear();
        self.higher.extend(over.map(|(&voxel, _)| voxel));
        let least = (COUCH * floor.inliers as f64) as usize;
        if self.higher.len() < least.max(min_points) {
            return None;
        }
        let higher = std::mem::take(&mut self.higher);
        let fit = self.find_lowest(&higher, params, rng);
        self.higher = higher;
        let couch = fit.filter(|fit| fit.inliers >= least && fit.plane.angle_to(&floor.plane) < LEVEL);
        self.measure(voxels, tolerance, couch.as_ref().unwrap_or(floor));
        couch
    }

    /// Whether too many voxels lie beneath the plane, within its hull, for it to support the other objects.
    fn are_many_beneath(&self, voxels: &[[f32; 3]], params: &FaceParams, fit: &PlaneFit) -> bool {
        let deep = -2.0 * params.plane_tolerance;
        let many = BENEATH * fit.inliers as f64;
        let beneath = || voxels.iter().zip(&self.heights).filter(|(_, height)| **height < deep);
        // Most frames have few at all, wherever they lie.
        beneath().count() as f64 > many
            && beneath().filter(|(voxel, _)| self.hull.contains(**voxel)).count() as f64 > many
    }
}
