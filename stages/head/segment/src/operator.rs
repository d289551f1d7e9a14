//! `segment.face`: the face out of a cloud, as an operator.

use nalgebra::Isometry3;
use stillpoint_operator::{Activation, Choice, Operator, Outputs, Params, Setup};
use stillpoint_operator::{
    AdoptError, FrameRule, Input, Kind, Output, ParamConflict, Policy, Role, SetupError, StepError, Timer,
};
use stillpoint_samples::{
    CloudShape, ClusterTable, ClusterTableShape, Corner, Diagnostics, Hull, HullShape, Plane, Point,
    PointCloud, Rejection, Sample,
};
use zerocopy::{FromBytes, IntoBytes};

use crate::cloud::Cloud;
use crate::face::{self, FaceParams, FaceSegmenter, Seen, SegmentationStep};
use crate::findings::{self, METRICS};
use crate::identity::{IdentityParams, Region};
use crate::mls::MlsParams;
use crate::outliers::OutlierParams;
use crate::table::ClusterRows;

/// The frame in whose axes the region is given.
const COUCH: &str = "couch";
const CLOUD: usize = 0;
const FACE: usize = 0;
const DIAGNOSTICS: usize = 1;
const PLANE: usize = 2;
const HULL: usize = 3;
const CLUSTERS: usize = 4;
const REJECTION: usize = 5;

/// Width of the cells in which neighbours of voxels are looked for, in voxels.
const NEIGHBOUR_CELL: f64 = 2.0;
/// Corners of a hull that are sent at most; of more, corners evenly spread over the outline.
const MAX_CORNERS: usize = 256;
/// Clusters that are sent at most, the largest ones.
const MAX_CLUSTERS: usize = 64;

/// Treatment of isolated voxels.
#[derive(Clone, Copy, Debug, Choice)]
pub enum Outliers {
    /// They are kept.
    Keep,
    /// They are removed, by the statistics of their neighbours' distances.
    Remove,
}

/// How voxels are smoothed.
#[derive(Clone, Copy, Debug, Choice)]
pub enum Smoothing {
    /// Not at all.
    Off,
    /// By robust moving least squares.
    MovingLeastSquares,
}

/// Rule by which voxels above the plane are the face.
#[derive(Clone, Copy, Debug, Choice)]
pub enum Rule {
    /// Those of the largest cluster.
    Largest,
    /// Those of a head, cut from what it touches.
    Head,
}

/// Whether a check is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum Check {
    /// It is required.
    Required,
    /// It is not required.
    Waived,
}

/// Where the head must be, in the axes of the frame `couch` (x to the left of a supine patient, y to the head end, z up).
#[derive(Clone, Debug, Params)]
pub struct RegionParams {
    /// Whether the head must lie in the region. `check` refuses a cloud whose frame is not placed on `couch`, unless both
    /// checks are waived; it refuses to waive them where valves or a beam follow a camera that is no `rig.*`.
    #[param(default = "required")]
    pub need: Check,
    /// Middle of the region along x and y: where the set-up places the head.
    #[param(unit = "m", default = "[0 mm, 0 mm]", min = "-3 m", max = "3 m")]
    pub at: [f64; 2],
    /// How far the middle of the head may be from there along x and along y.
    #[param(unit = "m", default = "160 mm", min = "20 mm", max = "1 m")]
    pub half: f64,
    /// Height of the middle of the head over the supporting plane: least and greatest.
    #[param(unit = "m", default = "[30 mm, 270 mm]", min = "0 mm", max = "1 m")]
    pub height: [f64; 2],
}

/// Parameters of `segment.face`. The defaults are for a head of any size, on whatever it rests, seen from 0.5 to 1 m.
#[derive(Clone, Debug, Params)]
pub struct SegmentParams {
    /// Width of a voxel.
    #[param(unit = "m", default = "5 mm", min = "0.5 mm", max = "50 mm")]
    pub leaf: f64,
    /// Points farther from the camera are ignored.
    #[param(unit = "m", default = "1.6 m", min = "100 mm", max = "10 m")]
    pub range_max: f64,
    /// Treatment of isolated voxels.
    #[param(default = "keep")]
    pub outliers: Outliers,
    /// Number of neighbours whose mean distance decides on an outlier, for `outliers: remove`.
    #[param(default = 30, min = 3, max = 200)]
    pub outlier_neighbours: u32,
    /// Standard deviations above the mean of these distances beyond which a voxel is an outlier.
    #[param(default = 2, min = 0.1, max = 10)]
    pub outlier_deviations: f64,
    /// Whether voxels are moved onto a fitted smooth surface.
    #[param(default = "off")]
    pub smoothing: Smoothing,
    /// Number of neighbours of the surface fit, for `smoothing: moving_least_squares`.
    #[param(default = 30, min = 9, max = 200)]
    pub smoothing_neighbours: u32,
    /// Distance within which a voxel belongs to the supporting plane.
    #[param(unit = "m", default = "10 mm", min = "0.1 mm", max = "100 mm", live)]
    pub plane_tolerance: f64,
    /// Largest number of plane hypotheses; eight times as many until a frame has had a plane.
    #[param(default = 500, min = 1, max = 100000)]
    pub iterations: u32,
    /// Smallest height of the face above the plane.
    #[param(unit = "m", default = "15 mm", above = "0 mm", max = "1 m", live)]
    pub height_min: f64,
    /// Largest height of the face above the plane.
    #[param(unit = "m", default = "360 mm", above = "0 mm", max = "2 m", live)]
    pub height_max: f64,
    /// Rule by which voxels above the plane are the face.
    #[param(default = "head")]
    pub rule: Rule,
    /// Mean distance of the surface of an adult head from its centre, for `rule: head`. Heads of 0.6 to 1.35 times this
    /// size are found.
    #[param(unit = "m", default = "90 mm", min = "20 mm", max = "300 mm")]
    pub head_radius: f64,
    /// Where the head must be, for `rule: head`.
    pub region: RegionParams,
    /// Whether a body must lie footwards of the head, with a neck or a valley between, for `rule: head`. Waive it for a
    /// phantom without a body.
    #[param(default = "required")]
    pub body: Check,
    /// A thing whose certainty to be the head is less than this below that of the best one makes the frame ambiguous.
    #[param(default = 0.2, min = 0, max = 0.5)]
    pub margin: f64,
    /// Distance within which two voxels belong to one cluster.
    #[param(unit = "m", default = "20 mm", min = "0.5 mm", max = "200 mm", live)]
    pub cluster_tolerance: f64,
    /// Smallest number of voxels of a face or a plane.
    #[param(default = 100, min = 3, max = 1000000, live)]
    pub min_voxels: u32,
    /// Largest number of points of a face. Of a larger face, points that are evenly spread over the order of the cloud
    /// are kept.
    #[param(default = 100000, min = 100, max = 4194304)]
    pub max_points: u32,
}

/// Finds the face in each cloud. For a frame without a face it sends diagnostics with the reason, and no face. A cloud
/// with the voxels of the cloud before, to the bit, is not searched: the outputs are the same, so that a frozen camera
/// is noticed.
pub struct SegmentFace {
    segmenter: FaceSegmenter,
    max_points: usize,
    /// Where the cloud is seen from, where that is known.
    couch_from_cloud: Option<Isometry3<f64>>,
    /// What the log has of the frame before: the code of its rejection, 0 for a face.
    logged: Option<u32>,
    /// Whether the last face had more points than are sent.
    is_thinned: bool,
}

impl Operator for SegmentFace {
    type Params = SegmentParams;
    const KIND: Kind = Kind {
        name: "segment.face",
        about: "Finds the face above the supporting plane: the head, separated from the objects that it touches, or the largest cluster.",
        role: Role::Operator,
        inputs: &[Input {
            name: "cloud",
            sample: PointCloud::KIND,
            policy: Policy::Queue(1),
            required: true,
            about: "The cloud of one frame, seen from the origin of its frame of reference.",
        }],
        outputs: &[
            Output {
                name: "face",
                sample: PointCloud::KIND,
                frame: FrameRule::SameAs("cloud"),
                about: "The face's points in the order of the cloud; not organised.",
            },
            Output {
                name: "diagnostics",
                sample: Diagnostics::KIND,
                frame: FrameRule::None,
                about: "Counts of each frame: points, voxels, tested hypotheses, plane, clusters and found points.",
            },
            Output {
                name: "plane",
                sample: Plane::KIND,
                frame: FrameRule::SameAs("cloud"),
                about: "The supporting plane, of each frame that has one.",
            },
            Output {
                name: "hull",
                sample: Hull::KIND,
                frame: FrameRule::SameAs("cloud"),
                about: "The convex outline of the voxels on the plane.",
            },
            Output {
                name: "clusters",
                sample: ClusterTable::KIND,
                frame: FrameRule::SameAs("cloud"),
                about: "The clusters above the plane, and which of them is the face.",
            },
            Output {
                name: "rejection",
                sample: Rejection::KIND,
                frame: FrameRule::None,
                about: "Sent if a frame has no face, with the reason: 1 too few voxels in range, 2 no plane, 3 no cluster, 4 no head, 5 nothing that is certain enough to be the head, 6 ambiguous.",
            },
        ],
        timer: Timer::No,
    };
    const LAPS: &'static [&'static str] = SegmentationStep::NAMES;

    fn validate(params: &SegmentParams) -> Result<(), ParamConflict> {
        let SegmentParams { height_min, height_max, .. } = *params;
        let [low, high] = params.region.height;
        if high <= low {
            return Err(ParamConflict {
                params: &["region"],
                reason: "the second of `region.height` must be greater than the first".into(),
                help: "give the least and then the greatest height of the middle of the head",
            });
        }
        if height_max > height_min {
            return Ok(());
        }
        let mm = |metres: f64| (metres * 1e6).round() / 1e3;
        Err(ParamConflict {
            params: &["height_min", "height_max"],
            reason: format!(
                "`height_max` is {} mm and must be greater than `height_min`, {} mm",
                mm(height_max),
                mm(height_min)
            ),
            help: "a face is between these heights over the plane: raise `height_max`, or lower `height_min`",
        })
    }

    fn new(params: SegmentParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        let couch_from_cloud = placed(setup);
        let chain = chain(&params, couch_from_cloud);
        let segmenter = FaceSegmenter::new(chain).map_err(|e| SetupError(e.to_string()))?;
        Ok(Self {
            segmenter,
            max_points: params.max_points as usize,
            couch_from_cloud,
            logged: None,
            is_thinned: false,
        })
    }

    /// A search with other thresholds knows nothing of earlier frames.
    fn adopt(&mut self, params: SegmentParams) -> Result<(), AdoptError> {
        let chain = chain(&params, self.couch_from_cloud);
        self.segmenter = FaceSegmenter::new(chain).map_err(|e| AdoptError(e.to_string()))?;
        Ok(())
    }

    fn capacities(params: &SegmentParams) -> Vec<usize> {
        vec![params.max_points as usize, METRICS, 1, MAX_CORNERS, MAX_CLUSTERS, 1]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let Some(cloud) = activation.input::<PointCloud>(CLOUD) else { return Ok(()) };
        let points = <[[f32; 3]]>::ref_from_bytes(cloud.elements.as_bytes())
            .map_err(|e| StepError(format!("the cloud's points cannot be read in place: {e}")))?;
        let organised =
            cloud.body.height > 1 && cloud.body.width as usize * cloud.body.height as usize == points.len();
        let width = if organised { cloud.body.width as usize } else { 0 };
        let mut ended = |step: SegmentationStep| outputs.lap(step as usize);
        let seen =
            self.segmenter.segment_in_steps(Cloud { points, width }, &mut activation.random(), &mut ended);
        log_change(&mut self.logged, seen.face.as_ref().err());
        let sent = match &seen.face {
            Ok(face) => {
                log_thinned(&mut self.is_thinned, face.len(), self.max_points);
                send_face(face, cloud.elements, self.max_points, outputs)?
            }
            Err(rejection) => {
                outputs.send::<Rejection>(REJECTION, &rejection.element())?;
                0
            }
        };
        send_surroundings(&seen, outputs)?;
        outputs.send_slice::<Diagnostics>(DIAGNOSTICS, &(), &findings::metrics(&seen, sent))
    }
}

/// Logs why frames have no face, and that they have one again: where it changes.
fn log_change(logged: &mut Option<u32>, rejection: Option<&face::Rejection>) {
    let element = rejection.map(face::Rejection::element);
    let code = element.as_ref().map_or(0, |element| element.code);
    let before = logged.replace(code);
    if before == Some(code) {
        return;
    }
    match element {
        Some(element) => tracing::warn!("no face: {}", element.reason()),
        None if before.is_some() => tracing::info!("a face again"),
        None => tracing::info!("a face"),
    }
}

/// Logs that a face begins to have more points than are sent.
fn log_thinned(logged: &mut bool, found: usize, most: usize) {
    if !std::mem::replace(logged, found > most) && found > most {
        tracing::warn!(
            "a face of {found} points is more than {most}, and some are left out: how much of the head is seen looks less; \
             raise `max_points`"
        );
    }
}

/// The chain of these parameters, for a cloud that is seen from there.
fn chain(params: &SegmentParams, couch_from_cloud: Option<Isometry3<f64>>) -> FaceParams {
    FaceParams {
        leaf: params.leaf,
        range_max: params.range_max,
        outliers: match params.outliers {
            Outliers::Keep => None,
            Outliers::Remove => Some(OutlierParams {
                neighbours: params.outlier_neighbours as usize,
                deviations: params.outlier_deviations,
                cell: NEIGHBOUR_CELL * params.leaf,
            }),
        },
        smoothing: match params.smoothing {
            Smoothing::Off => None,
            Smoothing::MovingLeastSquares => Some(MlsParams {
                neighbours: params.smoothing_neighbours as usize,
                deviations: 1.0,
                tolerance: params.plane_tolerance,
                cell: NEIGHBOUR_CELL * params.leaf,
            }),
        },
        plane_tolerance: params.plane_tolerance,
        iterations: params.iterations,
        height_min: params.height_min,
        height_max: params.height_max,
        cluster_tolerance: params.cluster_tolerance,
        min_points: params.min_voxels as usize,
        rule: match params.rule {
            Rule::Largest => face::Rule::Largest,
            Rule::Head => face::Rule::Head,
        },
        head_radius: params.head_radius,
        identity: identity(params, couch_from_cloud),
    }
}

/// Where the cloud is seen from, where its frame is placed on the couch.
fn placed(setup: &Setup<'_>) -> Option<Isometry3<f64>> {
    let frame = setup.input_frames.get(CLOUD).and_then(Option::as_deref)?;
    setup.transform(COUCH, frame).map(|transform| stillpoint_pose::of_frame(&transform))
}

/// The checks of identity, where the cloud's frame is placed on the couch and any is asked for.
fn identity(params: &SegmentParams, couch_from_cloud: Option<Isometry3<f64>>) -> Option<IdentityParams> {
    let couch_from_cloud = couch_from_cloud?;
    let RegionParams { need, at, half, height } = params.region;
    let region = (need == Check::Required).then_some(Region { at, half, height });
    let needs_body = params.body == Check::Required;
    if region.is_none() && !needs_body {
        return None;
    }
    Some(IdentityParams { couch_from_cloud, region, needs_body, margin: params.margin })
}

/// Sends the face's points, at most `most` of them, and says how many.
fn send_face(
    face: &[u32],
    cloud: &[Point],
    most: usize,
    outputs: &mut Outputs<'_>,
) -> Result<usize, StepError> {
    let count = face.len().min(most);
    let mut writer = outputs.open::<PointCloud>(FACE, count)?;
    *writer.body() = CloudShape { width: count as u32, height: 1, reserved: 0, length: count as u32 };
    for (k, slot) in writer.elements().iter_mut().enumerate() {
        let place = face[k * face.len() / count] as usize;
        *slot = cloud[place];
    }
    writer.finish(count)?;
    Ok(count)
}

/// Sends the plane, its hull and the clusters on it, as far as they were found.
fn send_surroundings(seen: &Seen<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
    let Some(plane) = &seen.plane else { return Ok(()) };
    outputs.send::<Plane>(PLANE, &findings::plane(plane))?;

    let found = seen.hull.corners().len();
    let count = found.min(MAX_CORNERS);
    let mut writer = outputs.open::<Hull>(HULL, count)?;
    *writer.body() = HullShape { area: seen.hull.area(), found: found as u32, length: count as u32 };
    for (k, slot) in writer.elements().iter_mut().enumerate() {
        *slot = Corner { xyz: seen.hull.corner_in_space(k * found / count) };
    }
    writer.finish(count)?;

    let found = seen.clusters.len();
    let count = found.min(MAX_CLUSTERS);
    let mut writer = outputs.open::<ClusterTable>(CLUSTERS, count)?;
    *writer.body() = ClusterTableShape { found: found as u32, length: count as u32 };
    let chosen = ClusterRows::chosen(seen.clusters);
    for (number, (slot, row)) in writer.elements().iter_mut().zip(seen.clusters).enumerate() {
        *slot = findings::cluster(row, chosen == Some(number));
    }
    writer.finish(count)
}
