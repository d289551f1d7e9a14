//! What `segment.face` says about a frame, as samples: the same named numbers for every frame, so that they can be
//! plotted; a row per cluster; the reason where there is no face.

use stillpoint_samples::{Cluster, ClusterEdge, Metric, PlaneElement, RejectionElement};

use crate::face::{Rejection, Seen};
use crate::identity::ENOUGH;
use crate::mlesac::{Origin, PlaneFit};
use crate::table::ClusterRow;

/// Numbers about one frame.
pub const METRICS: usize = 18;

/// What is not known of a frame: the one NaN, so that samples compare by bytes.
const UNKNOWN: f64 = f64::NAN;

/// Code of a frame that has a face.
pub const FOUND: u32 = 0;

impl Rejection {
    /// Number of the reason, from 1.
    #[must_use]
    pub fn code(&self) -> u32 {
        match self {
            Self::TooFewVoxels { .. } | Self::OutOfRange { .. } => 1,
            Self::NoPlane { .. } => 2,
            Self::NoCluster { .. } => 3,
            Self::NoHead { .. } | Self::SmallHead { .. } => 4,
            Self::Uncertain { .. } => 5,
            Self::Ambiguous { .. } => 6,
        }
    }

    /// What was found and what was needed.
    fn numbers(&self) -> (f64, f64) {
        match *self {
            Self::TooFewVoxels { found, needed }
            | Self::NoPlane { found, needed }
            | Self::NoCluster { above: found, needed }
            | Self::NoHead { above: found, needed, .. }
            | Self::SmallHead { found, needed } => (found as f64, needed as f64),
            Self::OutOfRange { needed, .. } => (0.0, needed as f64),
            Self::Uncertain { best } => (best.certainty(), ENOUGH),
            Self::Ambiguous { .. } => (2.0, 1.0),
        }
    }

    pub(crate) fn element(&self) -> RejectionElement {
        let (found, needed) = self.numbers();
        RejectionElement::new(self.code(), &self.to_string(), found, needed)
    }
}

/// The numbers of a frame, of whose face `sent` points were sent.
pub(crate) fn metrics(seen: &Seen<'_>, sent: usize) -> [Metric; METRICS] {
    let plane = |number: fn(&PlaneFit) -> f64| seen.plane.as_ref().map_or(UNKNOWN, number);
    let cluster = |place: usize| seen.clusters.get(place).map_or(0.0, |row| f64::from(row.voxels));
    let rejection = seen.face.as_ref().err();
    // Clusters of which a part is the face, and the rest was cut from it.
    let cut = || seen.clusters.iter().filter(|row| (1..row.voxels).contains(&row.face_voxels));
    [
        ("rejection", f64::from(rejection.map_or(FOUND, Rejection::code))),
        ("plane_normal_x", plane(|fit| fit.plane.normal.x)),
        ("plane_normal_y", plane(|fit| fit.plane.normal.y)),
        ("plane_normal_z", plane(|fit| fit.plane.normal.z)),
        ("plane_offset_m", plane(|fit| fit.plane.offset)),
        ("plane_voxels", plane(|fit| fit.inliers as f64)),
        ("plane_hypotheses", plane(|fit| f64::from(fit.hypotheses))),
        ("points_in_range", seen.points as f64),
        ("voxels", seen.voxels as f64),
        ("voxels_above", seen.above as f64),
        ("clusters", seen.clusters.len() as f64),
        ("largest_cluster_voxels", cluster(0)),
        ("second_cluster_voxels", cluster(1)),
        ("face_points", seen.face.as_ref().map_or(0.0, |face| face.len() as f64)),
        ("sent_points", sent as f64),
        ("outlier_voxels", seen.outliers as f64),
        ("clusters_cut", cut().count() as f64),
        ("cut_voxels", f64::from(cut().map(|row| row.voxels - row.face_voxels).sum::<u32>())),
    ]
    .map(|(name, value)| Metric::new(name, value))
}

pub(crate) fn plane(fit: &PlaneFit) -> PlaneElement {
    PlaneElement {
        normal: fit.plane.normal.into(),
        offset: fit.plane.offset,
        rms: fit.rms,
        inliers: fit.inliers as u32,
        points: fit.points as u32,
        kept: u32::from(fit.origin == Origin::Retained),
        hypotheses: fit.hypotheses,
    }
}

pub(crate) fn cluster(row: &ClusterRow, chosen: bool) -> Cluster {
    let bit = |is: bool, bit: u32| if is { bit } else { 0 };
    let [image, ceiling, hull] = row.touches;
    Cluster {
        centroid: row.centroid.into(),
        spread: row.spread.into(),
        height_min: row.heights[0],
        height_max: row.heights[1],
        voxels: row.voxels,
        touches: bit(image, ClusterEdge::AT_IMAGE_EDGE)
            | bit(ceiling, ClusterEdge::AT_CEILING)
            | bit(hull, ClusterEdge::AT_HULL_EDGE)
            | bit((1..row.voxels).contains(&row.face_voxels), ClusterEdge::CUT),
        face_voxels: row.face_voxels,
        chosen: u32::from(chosen),
    }
}
