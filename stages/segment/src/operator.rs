//! `segment.face`: the face out of a cloud, as an operator.

use stillpoint_pipeline::operator::{
    FrameRule, Input, Kind, Output, Policy, Role, SetupError, StepError, Timer,
};
use stillpoint_pipeline::{Activation, Operator, Outputs, Params, Setup};
use stillpoint_samples::{CloudShape, Diagnostics, Point, PointCloud, Sample};
use zerocopy::{FromBytes, IntoBytes};

use crate::face::{Face, FaceParams, FaceSegmenter};
use crate::findings::{self, METRICS};

const CLOUD: usize = 0;
const FACE: usize = 0;
const DIAGNOSTICS: usize = 1;

/// Parameters of `segment.face`. The defaults are for a head on a pad of up to 55 mm, seen from 0.5 to 1 m.
#[derive(Clone, Debug, Params)]
pub struct SegmentParams {
    /// Width of a voxel.
    #[param(unit = "m", default = "5 mm", min = "0.5 mm", max = "50 mm")]
    pub leaf: f64,
    /// Points farther from the camera are ignored.
    #[param(unit = "m", default = "1.6 m", min = "100 mm", max = "10 m")]
    pub range_max: f64,
    /// Distance within which a voxel belongs to the supporting plane.
    #[param(unit = "m", default = "10 mm", min = "0.1 mm", max = "100 mm")]
    pub plane_tolerance: f64,
    /// Plane hypotheses at most.
    #[param(default = 500, min = 1, max = 100000)]
    pub iterations: u32,
    /// Height over the plane at which the face starts.
    #[param(unit = "m", default = "60 mm", above = "0 mm", max = "1 m")]
    pub height_min: f64,
    /// Height over the plane at which the face ends.
    #[param(unit = "m", default = "360 mm", above = "0 mm", max = "2 m")]
    pub height_max: f64,
    /// Distance within which two voxels belong to one cluster.
    #[param(unit = "m", default = "20 mm", min = "0.5 mm", max = "200 mm")]
    pub cluster_tolerance: f64,
    /// Voxels that a face or a plane has at least.
    #[param(default = 100, min = 3, max = 1000000)]
    pub min_voxels: u32,
    /// Points of a face at most; of a larger one, points evenly spread over the order of the cloud are kept.
    #[param(default = 100000, min = 100, max = 4194304)]
    pub max_points: u32,
}

/// Finds the face in each cloud. A frame without a face sends diagnostics that say why, and no face.
pub struct SegmentFace {
    segmenter: FaceSegmenter,
    max_points: usize,
}

impl Operator for SegmentFace {
    type Params = SegmentParams;
    const KIND: Kind = Kind {
        name: "segment.face",
        about: "The face: the largest cluster of what stands over the supporting plane.",
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
                about: "Plane, clusters and points found, and why a frame has no face.",
            },
        ],
        timer: Timer::No,
    };

    fn new(params: SegmentParams, _: &Setup<'_>) -> Result<Self, SetupError> {
        let chain = FaceParams {
            leaf: params.leaf,
            range_max: params.range_max,
            plane_tolerance: params.plane_tolerance,
            iterations: params.iterations,
            height_min: params.height_min,
            height_max: params.height_max,
            cluster_tolerance: params.cluster_tolerance,
            min_points: params.min_voxels as usize,
        };
        let segmenter = FaceSegmenter::new(chain).map_err(|e| SetupError(e.to_string()))?;
        Ok(Self { segmenter, max_points: params.max_points as usize })
    }

    fn capacities(params: &SegmentParams) -> Vec<usize> {
        vec![params.max_points as usize, METRICS]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let Some(cloud) = activation.input::<PointCloud>(CLOUD) else { return Ok(()) };
        let points = <[[f32; 3]]>::ref_from_bytes(cloud.elements.as_bytes())
            .map_err(|e| StepError(format!("the cloud's points cannot be read in place: {e}")))?;
        let metrics = match self.segmenter.segment(points, &mut activation.random()) {
            Ok(face) => {
                let sent = send(&face, cloud.elements, self.max_points, outputs)?;
                findings::of_face(&face, sent)
            }
            Err(rejection) => findings::of_rejection(&rejection),
        };
        outputs.send_slice::<Diagnostics>(DIAGNOSTICS, &(), &metrics)
    }
}

/// Sends the face's points, at most `most` of them, and says how many.
fn send(
    face: &Face<'_>,
    cloud: &[Point],
    most: usize,
    outputs: &mut Outputs<'_>,
) -> Result<usize, StepError> {
    let found = face.indices.len();
    let count = found.min(most);
    let mut writer = outputs.open::<PointCloud>(FACE, count)?;
    *writer.body() = CloudShape { width: count as u32, height: 1, reserved: 0, length: count as u32 };
    for (k, slot) in writer.elements().iter_mut().enumerate() {
        let place = face.indices[k * found / count] as usize;
        *slot = cloud[place];
    }
    writer.finish(count)?;
    Ok(count)
}
