//! What the chain found in a frame, or why not.

use crate::head::Unlike;
use crate::hull::ConvexHull;
use crate::identity::Candidate;
use crate::mlesac::PlaneFit;
use crate::table::ClusterRow;
use thiserror::Error;

/// Why a frame has no face.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[non_exhaustive]
pub enum Rejection {
    /// Too few points within the range.
    #[error("the frame has {found} voxels within range, a face needs {needed}")]
    TooFewVoxels { found: usize, needed: usize },
    /// All points are beyond the range.
    #[error("0 voxels within {range} m; the nearest point is at {nearest:.1} m: {}", .advice.words())]
    OutOfRange {
        /// Range of the chain, m.
        range: f64,
        /// Distance of the nearest point, m.
        nearest: f32,
        /// What may be wrong.
        advice: Advice,
        needed: usize,
    },
    /// No plane holds enough voxels.
    #[error("the best plane holds {found} voxels, it needs {needed}")]
    NoPlane {
        /// Voxels on the best plane.
        found: usize,
        needed: usize,
    },
    /// What stands over the plane is too little or in too small pieces.
    #[error("{above} voxels are over the plane and no cluster of them has {needed}")]
    NoCluster {
        /// Voxels over the plane.
        above: usize,
        /// Voxels that a cluster needs.
        needed: usize,
    },
    /// No object above the plane has the size and roundness of a head.
    #[error("{}", text_of_unlike(*.above, *.unlike))]
    NoHead {
        /// Voxels over the plane.
        above: usize,
        /// Voxels that a head needs.
        needed: usize,
        /// What is amiss.
        unlike: Unlike,
    },
    /// What was cut out as the head has too few voxels.
    #[error("the head has {found} voxels, {needed} are needed: move the camera nearer or set `min_points`")]
    SmallHead { found: usize, needed: usize },
    /// Of the things of a head's size none passes the checks of identity.
    #[error("{}", text_of(.best, "the likeliest head"))]
    Uncertain { best: Candidate },
    /// Two things may be the head.
    #[error("ambiguous: {} or {}", placed(.both[0].place), placed(.both[1].place))]
    Ambiguous {
        /// The best two candidates.
        both: [Candidate; 2],
    },
}

/// What may be wrong with a cloud beyond the range.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Advice {
    Millimetres,
    Range,
}

impl Advice {
    /// A cloud in millimetres lies a thousand times farther than in metres.
    pub(super) fn of(nearest: f32, range: f64) -> Self {
        if f64::from(nearest) > UNIT_OFF * range { Self::Millimetres } else { Self::Range }
    }

    fn words(self) -> &'static str {
        match self {
            Self::Millimetres => "are these millimetres?",
            Self::Range => "raise `range_max`",
        }
    }
}

/// Ranges beyond which the nearest point of a cloud is likely to be in millimetres.
const UNIT_OFF: f64 = 20.0;

/// A place in the couch's frame, in mm.
fn placed(place: nalgebra::Vector3<f64>) -> String {
    let [x, y, z] = [place.x, place.y, place.z].map(|m| (m * 1e3).round());
    format!("({x}, {y}, {z}) mm")
}

/// At most 96 bytes, as all reasons are cut there.
fn text_of_unlike(above: usize, unlike: Unlike) -> String {
    let [mm, percent] = [1e3, 1e2].map(|unit| move |value: f64| (value * unit).round());
    match unlike {
        Unlike::Flat { radii: [least, greatest] } => {
            let (least, greatest) = (mm(least), mm(greatest));
            format!("{above} voxels are over the plane, none as round as a head ({least} to {greatest} mm)")
        }
        Unlike::Low { height, least } => {
            let (height, least) = (mm(height), mm(least));
            format!("a round thing's middle is {height} mm up, a head's {least}: lower what lies around it")
        }
        Unlike::Hidden { shown, least } => {
            let (shown, least) = (percent(shown), percent(least));
            format!(
                "a round thing shows {shown} % of its side, a head {least}: uncover it or move the camera"
            )
        }
    }
}

fn text_of(candidate: &Candidate, what: &str) -> String {
    let others = candidate.in_region.min(candidate.shape);
    let lacks = if candidate.alone < 1.0 && candidate.alone <= others {
        "cannot be cut from what touches it"
    } else if candidate.in_region < candidate.shape {
        "is out of the region"
    } else {
        candidate.lacks().words()
    };
    format!("{what} at {} {lacks}: certainty {:.2}", placed(candidate.place), candidate.certainty())
}

/// What was found in one frame, as far as it was found.
#[derive(Debug, Clone, Copy)]
pub struct Seen<'a> {
    pub points: usize,
    /// Voxels that they fell into, without outliers.
    pub voxels: usize,
    /// Voxels that were removed as outliers.
    pub outliers: usize,
    /// The supporting plane in the cloud's frame.
    pub plane: Option<PlaneFit>,
    /// Outline of the plane's inliers; empty before there is a plane.
    pub hull: &'a ConvexHull,
    /// Voxels between the two heights over the hull.
    pub above: usize,
    /// Each cluster of these, the largest first.
    pub clusters: &'a [ClusterRow],
    /// The things of a head's size, the likeliest head first; empty without checks of identity.
    pub candidates: &'a [Candidate],
    /// Where in the cloud the face's points are, rising, or why there is no face.
    pub face: Result<&'a [u32], Rejection>,
}

/// A step of the chain.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SegmentationStep {
    Voxel,
    /// Removal of outliers, where it is asked for.
    Outliers,
    /// Moving least squares, where they are asked for.
    Smooth,
    Plane,
    /// What stands over the plane's hull.
    Rise,
    Cluster,
    /// The table of the clusters.
    Describe,
    /// Which voxels are the face's.
    Head,
    /// The cloud's points in them.
    Gather,
}

impl SegmentationStep {
    /// Names of the steps, in their order.
    pub const NAMES: &'static [&'static str] =
        &["voxel", "outliers", "smooth", "plane", "rise", "cluster", "describe", "head", "gather"];
}
