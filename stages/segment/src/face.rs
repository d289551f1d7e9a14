//! From a cloud to the face: voxels, the supporting plane, what stands on it, its largest cluster.

use crate::cluster::EuclideanClusters;
use crate::hull::ConvexHull;
use crate::mlesac::{Mlesac, MlesacParams};
use crate::plane::Plane;
use crate::voxel::{NO_VOXEL, VoxelGrid};
use rand::Rng;
use thiserror::Error;

/// What the chain needs to know, in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FaceParams {
    /// Width of a voxel.
    pub leaf: f64,
    /// Points farther from the camera are ignored.
    pub range_max: f64,
    /// Distance within which a voxel belongs to the plane.
    pub plane_tolerance: f64,
    /// Plane hypotheses at most.
    pub iterations: u32,
    /// Height over the plane at which the face starts.
    pub height_min: f64,
    /// Height over the plane at which the face ends.
    pub height_max: f64,
    /// Distance within which two voxels belong to one cluster.
    pub cluster_tolerance: f64,
    /// Voxels that a face or a plane has at least.
    pub min_points: usize,
}

impl Default for FaceParams {
    /// A head on a pad of up to 55 mm, seen from 0.5 to 1 m.
    fn default() -> Self {
        Self {
            leaf: 0.005,
            range_max: 1.6,
            plane_tolerance: 0.01,
            iterations: 500,
            height_min: 0.06,
            height_max: 0.36,
            cluster_tolerance: 0.02,
            min_points: 100,
        }
    }
}

/// A parameter outside its range.
#[derive(Debug, Clone, PartialEq, Error)]
#[error("{name} is {value}; it must be {must}")]
pub struct ParamError {
    /// The parameter.
    pub name: &'static str,
    /// Its value, SI.
    pub value: f64,
    /// Its range, in words.
    pub must: &'static str,
}

/// Why a frame has no face.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Rejection {
    /// Too few points within the range.
    #[error("the frame has {found} voxels within range, a face needs {needed}")]
    TooFewVoxels {
        /// Voxels found.
        found: usize,
        /// Voxels needed.
        needed: usize,
    },
    /// No plane holds enough voxels.
    #[error("the best plane holds {found} voxels, it needs {needed}")]
    NoPlane {
        /// Voxels on the best plane.
        found: usize,
        /// Voxels needed.
        needed: usize,
    },
    /// What stands over the plane is too little or in too small pieces.
    #[error("{above} voxels stand over the plane and no cluster of them has {needed}")]
    NoCluster {
        /// Voxels over the plane.
        above: usize,
        /// Voxels that a cluster needs.
        needed: usize,
    },
}

/// The face of one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Face<'a> {
    /// The supporting plane in the cloud's frame.
    pub plane: Plane,
    /// Voxels on the plane.
    pub plane_inliers: usize,
    /// Voxels in each cluster over the plane, the largest, which is the face, first.
    pub cluster_sizes: &'a [u32],
    /// Where in the cloud the face's points are, rising.
    pub indices: &'a [u32],
}

/// The chain with its buffers; after the first frames of a size it allocates nothing.
#[derive(Debug, Clone)]
pub struct FaceSegmenter {
    params: FaceParams,
    grid: VoxelGrid,
    mlesac: Mlesac,
    hull: ConvexHull,
    clusters: EuclideanClusters,
    above: Vec<[f32; 3]>,
    /// For each voxel its place in `above`, or [`NO_VOXEL`].
    place_above: Vec<u32>,
    indices: Vec<u32>,
}

impl FaceSegmenter {
    /// A chain with checked parameters.
    ///
    /// # Errors
    /// The first parameter outside its range.
    pub fn new(params: FaceParams) -> Result<Self, ParamError> {
        check(&params)?;
        Ok(Self {
            params,
            grid: VoxelGrid::new(),
            mlesac: Mlesac::new(),
            hull: ConvexHull::new(),
            clusters: EuclideanClusters::new(),
            above: Vec::new(),
            place_above: Vec::new(),
            indices: Vec::new(),
        })
    }

    /// The parameters.
    #[must_use]
    pub fn params(&self) -> &FaceParams {
        &self.params
    }

    /// Finds the face in `cloud` (metres, camera frame; not finite is no point): all points in the voxels of the
    /// largest cluster between the two heights over the plane's inliers.
    ///
    /// # Errors
    /// Why the frame has no face; the next frame starts afresh.
    pub fn segment(&mut self, cloud: &[[f32; 3]], rng: &mut impl Rng) -> Result<Face<'_>, Rejection> {
        let params = self.params;
        let needed = params.min_points;
        self.grid.downsample(cloud, params.leaf, params.range_max);
        let voxels = self.grid.centroids();
        if voxels.len() < needed {
            return Err(Rejection::TooFewVoxels { found: voxels.len(), needed });
        }
        let search = MlesacParams { tolerance: params.plane_tolerance, iterations: params.iterations };
        let fit = self.mlesac.find(voxels, &search, rng).ok_or(Rejection::NoPlane { found: 0, needed })?;
        if fit.inliers < needed {
            return Err(Rejection::NoPlane { found: fit.inliers, needed });
        }
        self.rise(&fit.plane);
        self.clusters.find(&self.above, params.cluster_tolerance, needed);
        if self.clusters.sizes().is_empty() {
            return Err(Rejection::NoCluster { above: self.above.len(), needed });
        }
        self.gather();
        Ok(Face {
            plane: fit.plane,
            plane_inliers: fit.inliers,
            cluster_sizes: self.clusters.sizes(),
            indices: &self.indices,
        })
    }

    /// Picks the voxels between the two heights over the hull of the plane's inliers.
    fn rise(&mut self, plane: &Plane) {
        let params = self.params;
        let voxels = self.grid.centroids();
        let on = voxels.iter().copied().filter(|&p| plane.height(p).abs() <= params.plane_tolerance);
        self.hull.build(plane, on);
        self.above.clear();
        self.place_above.clear();
        for &voxel in voxels {
            let height = plane.height(voxel);
            let stands =
                height >= params.height_min && height <= params.height_max && self.hull.contains(voxel);
            self.place_above.push(if stands { self.above.len() as u32 } else { NO_VOXEL });
            if stands {
                self.above.push(voxel);
            }
        }
    }

    /// Collects the points of the cloud that lie in the largest cluster's voxels.
    fn gather(&mut self) {
        self.indices.clear();
        let labels = self.clusters.labels();
        for (point, &voxel) in self.grid.voxel_of_point().iter().enumerate() {
            let place = self.place_above.get(voxel as usize).copied().unwrap_or(NO_VOXEL);
            if labels.get(place as usize) == Some(&0) {
                self.indices.push(point as u32);
            }
        }
    }
}

fn check(params: &FaceParams) -> Result<(), ParamError> {
    let positive = |name, value: f64| {
        let fits = value.is_finite() && value > 0.0;
        if fits { Ok(()) } else { Err(ParamError { name, value, must: "finite and above 0" }) }
    };
    positive("leaf", params.leaf)?;
    positive("range_max", params.range_max)?;
    positive("plane_tolerance", params.plane_tolerance)?;
    positive("cluster_tolerance", params.cluster_tolerance)?;
    positive("height_min", params.height_min)?;
    positive("height_max", params.height_max)?;
    positive("iterations", f64::from(params.iterations))?;
    if params.height_max <= params.height_min {
        return Err(ParamError {
            name: "height_max",
            value: params.height_max,
            must: "greater than height_min",
        });
    }
    if params.min_points < 3 {
        let value = params.min_points as f64;
        return Err(ParamError { name: "min_points", value, must: "at least 3" });
    }
    Ok(())
}
