//! `track.forehead`: the distance to the forehead of a face that an image shows.

use stillpoint_operator::{Activation, Operator, Outputs, Params, Setup};
use stillpoint_operator::{FrameRule, Input, Kind, Output, Policy, Role, SetupError, StepError, Timer};
use stillpoint_samples::{FaceBoxes, PointCloud, Pose, PoseElement, Rejection, RejectionElement, Sample};
use zerocopy::{FromBytes, IntoBytes};

use crate::forehead::{FaceArea, Forehead, ForeheadFinder, HeadTop};

const CLOUD: usize = 0;
const FACES: usize = 1;
const POSITION: usize = 0;
const REJECTION: usize = 1;

const NO_FACE: u32 = 1;
const NO_POINTS: u32 = 2;

/// Parameters of `track.forehead`.
#[derive(Clone, Debug, Params)]
pub struct ForeheadParams {
    /// Standard deviation of the error that all points of a frame share, and of where the face is found.
    #[param(unit = "m", default = "1 mm", above = "0 mm", max = "100 mm")]
    pub shared_sd: f64,
}

/// Sends the forehead of the most certain face of each image, or why there is none.
pub struct TrackForehead {
    shared: f64,
    finder: ForeheadFinder,
}

impl Operator for TrackForehead {
    type Params = ForeheadParams;
    const KIND: Kind = Kind {
        name: "track.forehead",
        about: "Measures the distance from a camera to the forehead of a face in its image: one degree of freedom.",
        role: Role::Operator,
        inputs: &[
            Input {
                name: "cloud",
                sample: PointCloud::KIND,
                policy: Policy::Sync { within: 5_000_000 },
                required: true,
                about: "The camera's cloud, organised as its image.",
            },
            Input {
                name: "faces",
                sample: FaceBoxes::KIND,
                policy: Policy::Sync { within: 5_000_000 },
                required: true,
                about: "The faces in that image, in step with the cloud.",
            },
        ],
        outputs: &[
            Output {
                name: "position",
                sample: Pose::KIND,
                frame: FrameRule::SameAs("cloud"),
                about: "The forehead; all but its distance along the optical axis, z, has infinite variance.",
            },
            Output {
                name: "rejection",
                sample: Rejection::KIND,
                frame: FrameRule::None,
                about: "Sent if a frame has no forehead, with the reason: 1 no face, 2 too few points.",
            },
        ],
        timer: Timer::No,
    };

    fn new(params: ForeheadParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        if let [Some(cloud), Some(faces)] = setup.input_frames
            && cloud != faces
        {
            return Err(SetupError(format!(
                "its cloud is in the frame `{cloud}` and its faces are of an image in `{faces}`: both must come from one \
                 camera"
            )));
        }
        Ok(Self { shared: params.shared_sd * params.shared_sd, finder: ForeheadFinder::default() })
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let (Some(cloud), Some(faces)) =
            (activation.input::<PointCloud>(CLOUD), activation.input::<FaceBoxes>(FACES))
        else {
            return Ok(());
        };
        let [seen, shown] = [(cloud.body.width, cloud.body.height), (faces.body.width, faces.body.height)];
        if seen != shown {
            return Err(StepError(format!(
                "the cloud has {} x {} points and the image {} x {} pixels: both must be of one camera and size",
                seen.0, seen.1, shown.0, shown.1
            )));
        }
        let reject = |code, reason: &str, outputs: &mut Outputs<'_>| {
            outputs.send::<Rejection>(REJECTION, &RejectionElement::new(code, reason, 0.0, 1.0))
        };
        let Some(face) = faces.first() else {
            return reject(NO_FACE, "the image shows no face", outputs);
        };
        let points = <[[f32; 3]]>::ref_from_bytes(cloud.elements.as_bytes())
            .map_err(|e| StepError(format!("the cloud's points cannot be read in place: {e}")))?;
        let area = FaceArea {
            left: f64::from(face.left),
            top: f64::from(face.top),
            width: f64::from(face.width),
            height: f64::from(face.height),
        };
        let top = match faces.body.top {
            0 => HeadTop::Up,
            1 => HeadTop::Right,
            2 => HeadTop::Down,
            3 => HeadTop::Left,
            other => return Err(StepError(format!("no image has its top at {other}"))),
        };
        match self.finder.find(points, seen.0 as usize, &area, top) {
            Some(forehead) => outputs.send::<Pose>(POSITION, &self.element(&forehead)),
            None => reject(NO_POINTS, "the forehead's pixels were not measured", outputs),
        }
    }
}

impl TrackForehead {
    fn element(&self, forehead: &Forehead) -> PoseElement {
        let mut covariance = [0.0; 36];
        for i in 0..6 {
            covariance[7 * i] = if i == 2 { forehead.variance + self.shared } else { f64::INFINITY };
        }
        PoseElement { position: forehead.position, orientation: [1.0, 0.0, 0.0, 0.0], covariance }
    }
}
