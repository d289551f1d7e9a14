//! What `segment.face` says about a frame: the same named numbers for every frame, so that they can be plotted.

use stillpoint_samples::Metric;

use crate::face::{Face, Rejection};

/// Numbers about one frame.
pub const METRICS: usize = 13;

/// What is not known of a frame: the one NaN, so that samples compare by bytes.
const UNKNOWN: f64 = f64::NAN;

/// Code of a frame that has a face.
pub const FOUND: f64 = 0.0;
/// Code of [`Rejection::TooFewVoxels`].
pub const TOO_FEW_VOXELS: f64 = 1.0;
/// Code of [`Rejection::NoPlane`].
pub const NO_PLANE: f64 = 2.0;
/// Code of [`Rejection::NoCluster`].
pub const NO_CLUSTER: f64 = 3.0;

/// The numbers of a frame with a face, of which `sent` points were sent.
pub fn of_face(face: &Face<'_>, sent: usize) -> [Metric; METRICS] {
    let n = face.plane.normal;
    let cluster = |place: usize| face.cluster_sizes.get(place).map_or(0.0, |size| f64::from(*size));
    metrics([
        FOUND,
        n.x,
        n.y,
        n.z,
        face.plane.offset,
        face.plane_inliers as f64,
        face.cluster_sizes.len() as f64,
        cluster(0),
        cluster(1),
        face.indices.len() as f64,
        sent as f64,
        UNKNOWN,
        UNKNOWN,
    ])
}

/// The numbers of a frame without a face.
pub fn of_rejection(rejection: &Rejection) -> [Metric; METRICS] {
    let (code, found, needed) = match *rejection {
        Rejection::TooFewVoxels { found, needed } => (TOO_FEW_VOXELS, found, needed),
        Rejection::NoPlane { found, needed } => (NO_PLANE, found, needed),
        Rejection::NoCluster { above, needed } => (NO_CLUSTER, above, needed),
    };
    let mut values = [UNKNOWN; METRICS];
    values[0] = code;
    values[10] = 0.0;
    values[11] = found as f64;
    values[12] = needed as f64;
    metrics(values)
}

fn metrics(values: [f64; METRICS]) -> [Metric; METRICS] {
    const NAMES: [&str; METRICS] = [
        "rejection",
        "plane_normal_x",
        "plane_normal_y",
        "plane_normal_z",
        "plane_offset_m",
        "plane_voxels",
        "clusters",
        "largest_cluster_voxels",
        "second_cluster_voxels",
        "face_points",
        "sent_points",
        "rejected_with_voxels",
        "rejected_below_voxels",
    ];
    std::array::from_fn(|i| Metric::new(NAMES[i], values[i]))
}
