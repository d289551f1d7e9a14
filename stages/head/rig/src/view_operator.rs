//! `rig.view`: another camera over a rig's head, at its own place, rate and noise.

use stillpoint_operator::{Activation, Operator, Outputs, Params, Setup};
use stillpoint_operator::{FrameRule, Input, Kind, Output, Policy, Role, SetupError, StepError, Timer};
use stillpoint_samples::{DepthImage, Pose, Sample};

use crate::camera_view::{CameraView, ExpressionParams, ImageParams, Living, Neck, Noise, Setting};
use crate::setting;

const TRUTH: usize = 0;
const DEPTH: usize = 0;

/// Parameters of `rig.view`.
#[derive(Clone, Debug, Params)]
pub struct ViewParams {
    /// The camera whose noise is simulated.
    #[param(default = "structured_light")]
    pub noise: Noise,
    /// Pixels in a row.
    #[param(unit = "px", default = "640 px", min = "16 px", max = "2048 px")]
    pub width: u32,
    /// Rows.
    #[param(unit = "px", default = "480 px", min = "16 px", max = "2048 px")]
    pub height: u32,
    /// Focal length.
    #[param(unit = "px", default = "566 px", min = "8 px", max = "10000 px")]
    pub focal_length: f64,
    /// The object that the head rests on in the image: the same as in the rig.
    #[param(default = "pads")]
    pub setting: Setting,
    /// Size of the head: the same as in the rig.
    #[param(default = 1, min = 0.5, max = 1.5)]
    pub head_scale: f64,
    /// The neck: the same as in the rig.
    #[param(default = "rigid")]
    pub neck: Neck,
    /// Expressions of the face: the same as in the rig.
    pub expressions: Option<Vec<ExpressionParams>>,
}

impl ViewParams {
    fn image(&self) -> ImageParams {
        let Self { noise, width, height, focal_length, .. } = *self;
        ImageParams { noise, width, height, focal_length }
    }
}

/// Another camera over a rig's head. Its `frame:` places it over the couch.
///
/// It shows the head at the newest truth, which a rig sends at each of its ticks: no older than one of them.
pub struct CameraOperator {
    camera_view: CameraView,
    /// Time of the first truth, ns: the start of the rig.
    begin: Option<u64>,
}

impl Operator for CameraOperator {
    type Params = ViewParams;
    const KIND: Kind = Kind {
        name: "rig.view",
        about: "Simulates a further depth camera over the head of a rig, at its own place, rate and noise.",
        role: Role::Operator,
        inputs: &[Input {
            name: "truth",
            sample: Pose::KIND,
            policy: Policy::Latest,
            required: true,
            about: "The true pose of the head, from a rig, in the frame of the couch.",
        }],
        outputs: &[Output {
            name: "depth",
            sample: DepthImage::KIND,
            frame: FrameRule::Key,
            about: "The depth image, in counts of 0.1 mm.",
        }],
        timer: Timer::Required,
    };

    fn new(params: ViewParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        let rest = setting::Setting::from(params.setting).rest(params.head_scale);
        let living =
            Living { neck: params.neck, expressions: params.expressions.as_deref().unwrap_or(&[]), rest };
        let camera_view =
            CameraView::new(&params.image(), params.setting, params.head_scale, &living, setup)?;
        Ok(Self { camera_view, begin: None })
    }

    fn capacities(params: &ViewParams) -> Vec<usize> {
        vec![params.image().pixels()]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let Some(truth) = activation.input::<Pose>(TRUTH) else { return Ok(()) };
        let Some(pose) = truth.first() else { return Ok(()) };
        let begin = *self.begin.get_or_insert(truth.header.stamp);
        outputs.acquired_at(truth.header.stamp);
        self.camera_view.send(
            &stillpoint_pose::isometry(pose.position, pose.orientation),
            truth.header.stamp.saturating_sub(begin) as f64 * 1e-9,
            activation,
            outputs,
            DEPTH,
        )
    }
}
