//! From a cloud to the face: voxels, the supporting plane, what stands on it, its largest cluster.

use crate::cluster::EuclideanClusters;
use crate::head::{HeadFinder, HeadParams};
use crate::hull::ConvexHull;
use crate::mlesac::{Beneath, Mlesac, MlesacParams, PlaneFit};
use crate::mls::{MlsParams, MovingLeastSquares};
use crate::outliers::{OutlierFilter, OutlierParams};
use crate::plane::Plane;
use crate::table::{ClusterRow, ClusterRows, Touch};
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
    /// Voxels that stand apart are removed.
    pub outliers: Option<OutlierParams>,
    /// Voxels are moved onto the smooth surface that they lie on.
    pub smoothing: Option<MlsParams>,
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
    /// Which voxels over the plane are the face.
    pub rule: Rule,
    /// Mean distance of an adult head's surface from its middle, for [`Rule::Head`].
    pub head_radius: f64,
}

/// Which voxels over the plane are the face.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rule {
    /// Those of the largest cluster, as the source has it.
    Largest,
    /// Those of a head, cut from what it touches.
    Head,
}

impl Default for FaceParams {
    /// A head of any size on whatever it rests on, seen from 0.5 to 1 m.
    fn default() -> Self {
        Self {
            leaf: 0.005,
            range_max: 1.6,
            outliers: None,
            smoothing: None,
            plane_tolerance: 0.01,
            iterations: 500,
            height_min: 0.015,
            height_max: 0.36,
            cluster_tolerance: 0.02,
            min_points: 100,
            rule: Rule::Head,
            head_radius: 0.09,
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
#[derive(Debug, Clone, Copy, PartialEq, Error)]
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
    /// Nothing over the plane has the size and roundness of a head.
    #[error("{above} voxels stand over the plane and none of them are a head, which has {needed}")]
    NoHead {
        /// Voxels over the plane.
        above: usize,
        /// Voxels that a head needs.
        needed: usize,
    },
}

/// A cloud as the camera gives it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cloud<'a> {
    /// Points in metres in the camera's frame; one with a coordinate that is not finite is no point.
    pub points: &'a [[f32; 3]],
    /// Points in a row where they stand as the camera's grid, else 0.
    pub width: usize,
}

/// What was found in one frame, as far as it was found.
#[derive(Debug, Clone, Copy)]
pub struct Seen<'a> {
    /// Points within range.
    pub points: usize,
    /// Voxels that they fell into.
    pub voxels: usize,
    /// The supporting plane in the cloud's frame.
    pub plane: Option<PlaneFit>,
    /// Outline of the plane's inliers; empty before there is a plane.
    pub hull: &'a ConvexHull,
    /// Voxels between the two heights over the hull.
    pub above: usize,
    /// Each cluster of these, the largest first.
    pub clusters: &'a [ClusterRow],
    /// Where in the cloud the face's points are, rising, or why there is no face.
    pub face: Result<&'a [u32], Rejection>,
}

/// A step of the chain.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// The voxel grid.
    Voxel,
    /// Removal of outliers, where it is asked for.
    Outliers,
    /// Moving least squares, where they are asked for.
    Smooth,
    /// The supporting plane.
    Plane,
    /// What stands over the plane's hull.
    Rise,
    /// Clusters of that.
    Cluster,
    /// What is said of each cluster.
    Describe,
    /// Which voxels are the face's.
    Head,
    /// The cloud's points in them.
    Gather,
}

impl Step {
    /// Names of the steps, in their order.
    pub const NAMES: &'static [&'static str] =
        &["voxel", "outliers", "smooth", "plane", "rise", "cluster", "describe", "head", "gather"];
}

/// The chain with its buffers; after the first frames of a size it allocates nothing.
#[derive(Debug, Clone)]
pub struct FaceSegmenter {
    params: FaceParams,
    grid: VoxelGrid,
    outliers: OutlierFilter,
    mls: MovingLeastSquares,
    mlesac: Mlesac,
    /// The plane of the last frame that had one.
    prior: Option<Plane>,
    hull: ConvexHull,
    clusters: EuclideanClusters,
    table: ClusterRows,
    above: Vec<[f32; 3]>,
    /// For each voxel its place in `above`, or [`NO_VOXEL`].
    place_above: Vec<u32>,
    head: HeadFinder,
    /// For each place in `above`.
    is_face: Vec<bool>,
    pairs: Vec<[u32; 2]>,
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
            outliers: OutlierFilter::new(),
            mls: MovingLeastSquares::new(),
            mlesac: Mlesac::new(),
            prior: None,
            hull: ConvexHull::new(),
            clusters: EuclideanClusters::new(),
            table: ClusterRows::new(),
            above: Vec::new(),
            place_above: Vec::new(),
            head: HeadFinder::new(),
            is_face: Vec::new(),
            pairs: Vec::new(),
            indices: Vec::new(),
        })
    }

    /// The parameters.
    #[must_use]
    pub fn params(&self) -> &FaceParams {
        &self.params
    }

    /// Finds the face in `cloud`: all points in the voxels of the largest cluster between the two heights over the
    /// plane's inliers. The plane of the frame before is where the search for this one's begins; nothing else is left
    /// from frame to frame.
    pub fn segment(&mut self, cloud: Cloud<'_>, rng: &mut impl Rng) -> Seen<'_> {
        self.segment_in_steps(cloud, rng, &mut |_| {})
    }

    /// As [`segment`](Self::segment), and says when a step has ended.
    pub fn segment_in_steps(
        &mut self,
        cloud: Cloud<'_>,
        rng: &mut impl Rng,
        ended: &mut impl FnMut(Step),
    ) -> Seen<'_> {
        self.above.clear();
        self.table.clear();
        self.hull.clear();
        let (plane, face) = match self.stand(cloud, rng, ended) {
            Ok(plane) => (Some(plane), self.choose(cloud, &plane.plane, ended)),
            Err(rejection) => (None, Err(rejection)),
        };
        Seen {
            points: self.grid.points(),
            voxels: self.grid.centroids().len(),
            plane,
            hull: &self.hull,
            above: self.above.len(),
            clusters: self.table.rows(),
            face: face.map(|()| self.indices.as_slice()),
        }
    }

    /// Voxels and the plane that most of them lie on.
    fn stand(
        &mut self,
        cloud: Cloud<'_>,
        rng: &mut impl Rng,
        ended: &mut impl FnMut(Step),
    ) -> Result<PlaneFit, Rejection> {
        let params = self.params;
        let needed = params.min_points;
        self.grid.downsample(cloud.points, params.leaf, params.range_max);
        ended(Step::Voxel);
        if let Some(outliers) = &params.outliers {
            self.grid.retain(self.outliers.keep(self.grid.centroids(), outliers));
            ended(Step::Outliers);
        }
        if let Some(smoothing) = &params.smoothing {
            self.grid.replace(self.mls.smooth(self.grid.centroids(), smoothing, rng));
            ended(Step::Smooth);
        }
        let voxels = self.grid.centroids();
        if voxels.len() < needed {
            return Err(Rejection::TooFewVoxels { found: voxels.len(), needed });
        }
        let FaceParams { plane_tolerance: tolerance, iterations, .. } = params;
        let search = MlesacParams { tolerance, iterations, beneath: Beneath::Outliers };
        let mut fit = self.mlesac.find(voxels, self.prior.as_ref(), &search, rng);
        // A plane over the tops of pillows and shoulders may hold more voxels than what is left of the couch.
        if let Some(found) = fit {
            self.hull.build(&found.plane, on(voxels, &found.plane, tolerance));
            let beneath =
                |p: &&[f32; 3]| found.plane.height(**p) < -2.0 * tolerance && self.hull.contains(**p);
            let beneath = voxels.iter().filter(beneath).count();
            if beneath as f64 > BENEATH * found.inliers as f64 {
                let search = MlesacParams { beneath: Beneath::Unlikely, ..search };
                fit = self.mlesac.find(voxels, self.prior.as_ref(), &search, rng);
            }
        }
        let fit = fit.ok_or(Rejection::NoPlane { found: 0, needed })?;
        if fit.inliers < needed {
            return Err(Rejection::NoPlane { found: fit.inliers, needed });
        }
        self.prior = Some(fit.plane);
        ended(Step::Plane);
        Ok(fit)
    }

    /// What stands on the plane, its clusters, and the points of the face.
    fn choose(
        &mut self,
        cloud: Cloud<'_>,
        plane: &Plane,
        ended: &mut impl FnMut(Step),
    ) -> Result<(), Rejection> {
        let needed = self.params.min_points;
        self.rise(plane);
        ended(Step::Rise);
        self.clusters.find(&self.above, self.params.cluster_tolerance, needed);
        ended(Step::Cluster);
        self.describe(cloud, plane);
        ended(Step::Describe);
        let above = self.above.len();
        if self.clusters.sizes().is_empty() {
            return Err(Rejection::NoCluster { above, needed });
        }
        self.is_face.clear();
        match self.params.rule {
            Rule::Largest => self.is_face.extend(self.clusters.labels().iter().map(|&label| label == 0)),
            Rule::Head => {
                self.pairs.clear();
                pairs_seen(cloud, self.grid.voxel_of_point(), &self.place_above, &mut self.pairs);
                let FaceParams { head_radius: radius, leaf, height_min, .. } = self.params;
                let head = HeadParams { radius, leaf, height_min };
                if !self.head.find(&self.above, &self.pairs, plane, &head) {
                    return Err(Rejection::NoHead { above, needed });
                }
                self.is_face.extend_from_slice(self.head.is_head());
            }
        }
        ended(Step::Head);
        if self.is_face.iter().filter(|&&is| is).count() < needed {
            return Err(Rejection::NoHead { above, needed });
        }
        for (_, &label) in self.is_face.iter().zip(self.clusters.labels()).filter(|(is, _)| **is) {
            self.table.add_face(label);
        }
        self.gather();
        ended(Step::Gather);
        Ok(())
    }

    /// Picks the voxels between the two heights over the hull of the plane's inliers.
    fn rise(&mut self, plane: &Plane) {
        let params = self.params;
        let voxels = self.grid.centroids();
        self.hull.build(plane, on(voxels, plane, params.plane_tolerance));
        self.place_above.clear();
        // A neck or shoulders may hang over the edge of what is seen of the couch.
        let beyond = match params.rule {
            Rule::Largest => 0.0,
            Rule::Head => BEYOND * params.head_radius,
        };
        for &voxel in voxels {
            let height = plane.height(voxel);
            let stands = height >= params.height_min
                && height <= params.height_max
                && (self.hull.contains(voxel) || beyond > 0.0 && self.hull.margin(voxel) > -beyond);
            self.place_above.push(if stands { self.above.len() as u32 } else { NO_VOXEL });
            if stands {
                self.above.push(voxel);
            }
        }
    }

    fn describe(&mut self, cloud: Cloud<'_>, plane: &Plane) {
        let params = self.params;
        self.table.start(self.clusters.sizes().len());
        for (&voxel, &label) in self.above.iter().zip(self.clusters.labels()) {
            let height = plane.height(voxel);
            self.table.add(label, voxel, height);
            if height > params.height_max - params.leaf {
                self.table.touch(label, Touch::Ceiling);
            }
            if self.hull.margin(voxel) < params.leaf {
                self.table.touch(label, Touch::HullEdge);
            }
        }
        for point in border(cloud) {
            if let Some(label) = self.label_of_point(point) {
                self.table.touch(label, Touch::ImageEdge);
            }
        }
        self.table.finish();
    }

    /// The cluster of a point of the cloud.
    fn label_of_point(&self, point: usize) -> Option<u32> {
        let voxel = *self.grid.voxel_of_point().get(point)?;
        let place = *self.place_above.get(voxel as usize)?;
        self.clusters.labels().get(place as usize).copied()
    }

    /// Collects the points of the cloud that lie in the face's voxels.
    fn gather(&mut self) {
        self.indices.clear();
        for (point, &voxel) in self.grid.voxel_of_point().iter().enumerate() {
            let place = self.place_above.get(voxel as usize).copied().unwrap_or(NO_VOXEL);
            if self.is_face.get(place as usize) == Some(&true) {
                self.indices.push(point as u32);
            }
        }
    }
}

/// The voxels within a tolerance of a plane.
fn on<'v>(voxels: &'v [[f32; 3]], plane: &Plane, tolerance: f64) -> impl Iterator<Item = [f32; 3]> + 'v {
    let plane = *plane;
    voxels.iter().copied().filter(move |&p| plane.height(p).abs() <= tolerance)
}

/// In head radii: so far beyond the hull a head and what it touches are looked for.
const BEYOND: f64 = 2.5;
/// A plane with this part of its inliers' number beneath it, within its hull, supports nothing.
const BENEATH: f64 = 0.15;
/// Pixels that were not measured between two that count as beside each other, at most.
const BLIND: usize = 12;
/// Every so many rows and columns are looked at.
const STRIDE: usize = 2;

/// Pairs of voxels over the plane that are seen beside each other, in every second row and column: those between which
/// nothing else is seen.
fn pairs_seen(cloud: Cloud<'_>, voxel_of_point: &[u32], place_above: &[u32], pairs: &mut Vec<[u32; 2]>) {
    let width = cloud.width;
    let height = cloud.points.len().checked_div(width).unwrap_or(0);
    let mut walk = |first: usize, step: usize, count: usize| {
        let (mut last, mut blind) = (NO_VOXEL, 0);
        for point in (0..count).map(|i| first + i * step) {
            let Some(&place) = place_above.get(voxel_of_point[point] as usize) else {
                blind += 1;
                continue;
            };
            if last != NO_VOXEL && place != NO_VOXEL && last != place && blind <= BLIND {
                pairs.push([last, place]);
            }
            (last, blind) = (place, 0);
        }
    };
    (0..height).step_by(STRIDE).for_each(|v| walk(v * width, 1, width));
    (0..width).step_by(STRIDE).for_each(|u| walk(u, width, height));
}

/// The points along the edge of the image; none where the cloud is no image.
fn border(cloud: Cloud<'_>) -> impl Iterator<Item = usize> {
    let width = cloud.width;
    let height = cloud.points.len().checked_div(width).unwrap_or(0);
    let rows = (0..width).flat_map(move |u| [u, height.saturating_sub(1) * width + u]);
    let columns = (0..height).flat_map(move |v| [v * width, v * width + width.saturating_sub(1)]);
    rows.chain(columns)
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
    positive("head_radius", params.head_radius)?;
    positive("iterations", f64::from(params.iterations))?;
    if let Some(outliers) = &params.outliers {
        positive("outlier neighbours", outliers.neighbours as f64)?;
        positive("outlier deviations", outliers.deviations)?;
        positive("outlier cell", outliers.cell)?;
    }
    if let Some(smoothing) = &params.smoothing {
        positive("smoothing neighbours", smoothing.neighbours as f64)?;
        positive("smoothing deviations", smoothing.deviations)?;
        positive("smoothing tolerance", smoothing.tolerance)?;
        positive("smoothing cell", smoothing.cell)?;
    }
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
