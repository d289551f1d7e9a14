//! The chain from a cloud to the face.

use super::pairs::PairsSeen;
use super::params::{FaceParams, ParamError, Rule, check};
use super::seen::{Advice, Rejection, Seen, SegmentationStep};
use super::support::Support;
use crate::cloud::Cloud;
use crate::cluster::EuclideanClusters;
use crate::head::{HeadFinder, HeadParams, NoHead};
use crate::mlesac::PlaneFit;
use crate::mls::MovingLeastSquares;
use crate::outliers::OutlierFilter;
use crate::plane::Plane;
use crate::table::{ClusterRows, Touch};
use crate::voxel::{NO_VOXEL, VoxelGrid};
use rand::Rng;

/// In head radii: so far beyond the hull a head and what it touches are looked for.
const BEYOND: f64 = 2.5;
/// The chain with its buffers; after the first frames of a size it allocates nothing.
#[derive(Debug, Clone)]
pub struct FaceSegmenter {
    params: FaceParams,
    grid: VoxelGrid,
    outliers: OutlierFilter,
    /// Voxels of this frame that were outliers.
    removed: usize,
    mls: MovingLeastSquares,
    support: Support,
    clusters: EuclideanClusters,
    table: ClusterRows,
    above: Vec<[f32; 3]>,
    /// For each place in `above` the height over the plane and the margin to the hull's edge.
    stand: Vec<[f64; 2]>,
    /// For each voxel its place in `above`, or [`NO_VOXEL`].
    place_above: Vec<u32>,
    head: HeadFinder,
    /// For each voxel the patch that it is in, or [`NO_VOXEL`].
    patches: Vec<u32>,
    /// For each place in `above`.
    is_face: Vec<bool>,
    pairs: PairsSeen,
    face_voxels: Vec<bool>,
    indices: Vec<u32>,
    found: Option<Found>,
}

/// What the last frame came to.
#[derive(Debug, Clone, Copy)]
struct Found {
    plane: Option<PlaneFit>,
    face: Result<(), Rejection>,
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
            removed: 0,
            mls: MovingLeastSquares::new(),
            support: Support::default(),
            clusters: EuclideanClusters::new(),
            table: ClusterRows::new(),
            above: Vec::new(),
            stand: Vec::new(),
            place_above: Vec::new(),
            head: HeadFinder::new(),
            patches: Vec::new(),
            is_face: Vec::new(),
            pairs: PairsSeen::default(),
            face_voxels: Vec::new(),
            indices: Vec::new(),
            found: None,
        })
    }

    #[must_use]
    pub fn params(&self) -> &FaceParams {
        &self.params
    }

    /// Finds the face in `cloud`: all points in the voxels of the largest cluster between the two heights above the
    /// plane's inliers. The search for the plane begins with the plane of the frame before; no other state is kept. A
    /// frame with the voxels of the frame before, to the bit, is not searched again: the result of the same image is
    /// the same, so that a frozen camera is noticed downstream.
    pub fn segment(&mut self, cloud: Cloud<'_>, rng: &mut impl Rng) -> Seen<'_> {
        self.segment_in_steps(cloud, rng, &mut |_| {})
    }

    /// As [`segment`](Self::segment), and says when a step has ended.
    pub fn segment_in_steps(
        &mut self,
        cloud: Cloud<'_>,
        rng: &mut impl Rng,
        ended: &mut impl FnMut(SegmentationStep),
    ) -> Seen<'_> {
        self.simplify(cloud, ended);
        // Two clouds beyond the range have the same voxels, none, and lie at different distances.
        let repeated = self.found.filter(|_| self.grid.is_repeated() && !self.grid.centroids().is_empty());
        let found = repeated.unwrap_or_else(|| self.search(cloud, rng, ended));
        self.found = Some(found);
        if found.face.is_ok() {
            self.gather();
            ended(SegmentationStep::Gather);
        }
        Seen {
            points: self.grid.points(),
            voxels: self.grid.centroids().len(),
            outliers: self.removed,
            plane: found.plane,
            hull: self.support.hull(),
            above: self.above.len(),
            clusters: self.table.rows(),
            candidates: self.head.candidates(),
            face: found.face.map(|()| self.indices.as_slice()),
        }
    }

    fn simplify(&mut self, cloud: Cloud<'_>, ended: &mut impl FnMut(SegmentationStep)) {
        self.grid.downsample(cloud, self.params.leaf, self.params.range_max);
        ended(SegmentationStep::Voxel);
        self.removed = 0;
        if let Some(outliers) = &self.params.outliers {
            let before = self.grid.centroids().len();
            self.grid.retain(self.outliers.keep(self.grid.centroids(), outliers));
            self.removed = before - self.grid.centroids().len();
            ended(SegmentationStep::Outliers);
        }
    }

    /// Plane and face among the voxels.
    fn search(
        &mut self,
        cloud: Cloud<'_>,
        rng: &mut impl Rng,
        ended: &mut impl FnMut(SegmentationStep),
    ) -> Found {
        self.above.clear();
        self.head.forget();
        self.table.clear();
        self.support.clear();
        match self.stand(rng, ended) {
            Ok(plane) => Found { plane: Some(plane), face: self.choose(cloud, &plane.plane, ended) },
            Err(Rejection::TooFewVoxels { found: 0, needed }) => {
                Found { plane: None, face: Err(self.out_of_range(cloud, needed)) }
            }
            Err(rejection) => Found { plane: None, face: Err(rejection) },
        }
    }

    /// Why no point of a cloud is within the range.
    fn out_of_range(&self, cloud: Cloud<'_>, needed: usize) -> Rejection {
        let range = self.params.range_max;
        let squared = |p: &[f32; 3]| p.iter().map(|c| c * c).sum::<f32>();
        let squares = cloud.points.iter().map(squared).filter(|s| s.is_finite());
        match squares.min_by(f32::total_cmp).map(f32::sqrt).filter(|nearest| f64::from(*nearest) > range) {
            Some(nearest) => {
                Rejection::OutOfRange { range, nearest, advice: Advice::of(nearest, range), needed }
            }
            None => Rejection::TooFewVoxels { found: 0, needed },
        }
    }

    /// The plane that most voxels lie on.
    #[expect(
        clippy::result_large_err,
        reason = "a rejection is an ordinary result of a frame, and a frame does not allocate"
    )]
    fn stand(
        &mut self,
        rng: &mut impl Rng,
        ended: &mut impl FnMut(SegmentationStep),
    ) -> Result<PlaneFit, Rejection> {
        let params = self.params;
        let needed = params.min_points;
        if let Some(smoothing) = &params.smoothing {
            self.grid.replace(self.mls.smooth(self.grid.centroids(), smoothing, rng));
            ended(SegmentationStep::Smooth);
        }
        let found = self.grid.centroids().len();
        if found < needed {
            return Err(Rejection::TooFewVoxels { found, needed });
        }
        let fit = self.support.find(self.grid.centroids(), &params, rng);
        let fit = fit.ok_or(Rejection::NoPlane { found: 0, needed })?;
        if fit.inliers < needed {
            return Err(Rejection::NoPlane { found: fit.inliers, needed });
        }
        self.support.keep(fit.plane);
        ended(SegmentationStep::Plane);
        Ok(fit)
    }

    /// What stands on the plane, its clusters, and the voxels of the face.
    #[expect(
        clippy::result_large_err,
        reason = "a rejection is an ordinary result of a frame, and a frame does not allocate"
    )]
    fn choose(
        &mut self,
        cloud: Cloud<'_>,
        plane: &Plane,
        ended: &mut impl FnMut(SegmentationStep),
    ) -> Result<(), Rejection> {
        let needed = self.params.min_points;
        self.rise();
        ended(SegmentationStep::Rise);
        self.clusters.find(&self.above, self.params.cluster_tolerance, needed);
        ended(SegmentationStep::Cluster);
        self.describe(cloud);
        ended(SegmentationStep::Describe);
        let above = self.above.len();
        if self.clusters.sizes().is_empty() {
            return Err(Rejection::NoCluster { above, needed });
        }
        self.is_face.clear();
        match self.params.rule {
            Rule::Largest => self.is_face.extend(self.clusters.labels().iter().map(|&label| label == 0)),
            Rule::Head => {
                let FaceParams { head_radius: radius, leaf, height_min, identity, .. } = self.params;
                let patch_above = self.head.gather(&self.above, leaf);
                let patch = |&place: &u32| patch_above.get(place as usize).copied().unwrap_or(NO_VOXEL);
                self.patches.clear();
                self.patches.extend(self.place_above.iter().map(patch));
                let pairs = self.pairs.find(cloud, self.grid.voxel_of_point(), &self.patches);
                let params = HeadParams { radius, leaf, height_min, identity };
                if let Err(why) = self.head.find(pairs, plane, &params) {
                    return Err(match (why, self.head.candidates()) {
                        (NoHead::Ambiguous, [first, second, ..]) => {
                            Rejection::Ambiguous { both: [*first, *second] }
                        }
                        (NoHead::Uncertain, [best, ..]) => Rejection::Uncertain { best: *best },
                        (NoHead::Nothing(unlike), _) => Rejection::NoHead { above, needed, unlike },
                        _ => Rejection::SmallHead { found: 0, needed },
                    });
                }
                self.is_face.extend_from_slice(self.head.is_head());
            }
        }
        ended(SegmentationStep::Head);
        let found = self.is_face.iter().filter(|&&is| is).count();
        if found < needed {
            return Err(Rejection::SmallHead { found, needed });
        }
        for (_, &label) in self.is_face.iter().zip(self.clusters.labels()).filter(|(is, _)| **is) {
            self.table.add_face(label);
        }
        Ok(())
    }

    /// Picks the voxels between the two heights over the hull of the plane's inliers.
    fn rise(&mut self) {
        let FaceParams { height_min, height_max, .. } = self.params;
        // A neck or shoulders may hang over the edge of what is seen of the couch.
        let beyond = match self.params.rule {
            Rule::Largest => 0.0,
            Rule::Head => BEYOND * self.params.head_radius,
        };
        self.place_above.clear();
        self.stand.clear();
        for (&voxel, &height) in self.grid.centroids().iter().zip(self.support.heights()) {
            let margin = if height >= height_min && height <= height_max {
                self.support.hull().margin(voxel)
            } else {
                f64::NEG_INFINITY
            };
            let stands = margin >= -beyond;
            self.place_above.push(if stands { self.above.len() as u32 } else { NO_VOXEL });
            if stands {
                self.above.push(voxel);
                self.stand.push([height, margin]);
            }
        }
    }

    fn describe(&mut self, cloud: Cloud<'_>) {
        let params = self.params;
        self.table.start(self.clusters.sizes().len());
        let stand = self.above.iter().zip(&self.stand);
        for ((&voxel, &[height, margin]), &label) in stand.zip(self.clusters.labels()) {
            self.table.add(label, voxel, height);
            if height > params.height_max - params.leaf {
                self.table.touch(label, Touch::Ceiling);
            }
            if margin < params.leaf {
                self.table.touch(label, Touch::HullEdge);
            }
        }
        for point in cloud.border() {
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
        self.face_voxels.clear();
        let is_face = |&place: &u32| self.is_face.get(place as usize) == Some(&true);
        self.face_voxels.extend(self.place_above.iter().map(is_face));
        self.indices.clear();
        let inside = |voxel: &u32| self.face_voxels.get(*voxel as usize) == Some(&true);
        let points = self.grid.voxel_of_point().iter().enumerate();
        self.indices.extend(points.filter(|(_, voxel)| inside(voxel)).map(|(point, _)| point as u32));
    }
}
