//! `rig.camera`: the virtual rig as an operator. A depth image of the head at each tick, and where the head truly is.

use nalgebra::Isometry3;
use stillpoint_operator::{Activation, Choice, Operator, Outputs, Params, Setup};
use stillpoint_operator::{
    AdoptError, FrameRule, Kind, Output, ParamConflict, Role, SetupError, StepError, Timer,
};
use stillpoint_samples::{DepthImage, Pose, Sample};

use crate::camera_view::{
    COUCH, CameraView, ExpressionParams, ImageParams, Living, Neck, Noise, Setting, exact_pose, refusal,
};
use crate::phantom::Phantom;
use crate::phantom_params::{self, PhantomParams};
use crate::setting;
use crate::trajectory::{self, Trajectory};

const DEPTH: usize = 0;
const TRUTH: usize = 1;

/// The script of the head's motion.
#[derive(Clone, Copy, Debug, Choice)]
pub enum Motion {
    /// Nothing moves.
    Still,
    /// Every 10 s the head moves to another pose and stays there.
    Steps,
    /// Slow nodding, breathing, drift, and a cough now and then.
    Nods,
    /// Height, pitch and roll change for 30 s, then stay.
    Sweep,
    /// The height alone rises by 15 mm and falls again, every 30 s.
    Raise,
}

/// Parameters of `rig.camera`.
#[derive(Clone, Debug, Params)]
pub struct CameraParams {
    /// The script of the head's motion.
    #[param(default = "nods", live)]
    pub motion: Motion,
    /// Seed of the head's script. The camera's noise comes from the pipeline's seed.
    #[param(default = 7, live)]
    pub seed: u64,
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
    /// The objects that the head rests on and touches.
    #[param(default = "pads")]
    pub setting: Setting,
    /// Size of the head; 1 is an adult's head.
    #[param(default = 1, min = 0.5, max = 1.5)]
    pub head_scale: f64,
    /// The neck. `skin` bends between the head and a torso whose chest breathes.
    #[param(default = "rigid")]
    pub neck: Neck,
    /// Expressions of the face and their times.
    pub expressions: Option<Vec<ExpressionParams>>,
    /// Moves of a phantom in place of the head, in the order of their times. With it, `motion` has no effect.
    pub phantom: Option<Vec<PhantomParams>>,
}

impl CameraParams {
    fn image(&self) -> ImageParams {
        let Self { noise, width, height, focal_length, .. } = *self;
        ImageParams { noise, width, height, focal_length }
    }
}

/// The rig's camera. Its `frame:` places it over the couch.
pub struct Camera {
    camera_view: CameraView,
    script: Trajectory,
    /// Where the head lies without motion.
    rest: Isometry3<f64>,
    /// What lies there in place of the head.
    phantom: Option<Phantom>,
    /// Time of the first activation, ns: the script's zero.
    begin: Option<u64>,
}

impl Operator for Camera {
    type Params = CameraParams;
    const KIND: Kind = Kind {
        name: "rig.camera",
        about: "Simulates a head on a couch that moves by a script, seen by a depth camera.",
        role: Role::Operator,
        inputs: &[],
        outputs: &[
            Output {
                name: "depth",
                sample: DepthImage::KIND,
                frame: FrameRule::Key,
                about: "The depth image, in counts of 0.1 mm.",
            },
            Output {
                name: "truth",
                sample: Pose::KIND,
                frame: FrameRule::Named(COUCH),
                about: "The head's true pose, couch_from_head; its origin is between the ear canals.",
            },
        ],
        timer: Timer::Required,
    };

    fn validate(params: &CameraParams) -> Result<(), ParamConflict> {
        phantom_params::check(params.phantom.as_deref())
    }

    fn new(params: CameraParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        let rest = setting::Setting::from(params.setting).rest(params.head_scale);
        let living =
            Living { neck: params.neck, expressions: params.expressions.as_deref().unwrap_or(&[]), rest };
        Ok(Self {
            camera_view: CameraView::new(&params.image(), params.setting, params.head_scale, &living, setup)?,
            script: Trajectory::new(params.motion.into(), params.seed, rest),
            rest,
            phantom: phantom_params::phantom(params.phantom.as_deref()).map_err(refusal)?,
            begin: None,
        })
    }

    /// Another script is at its place of the time at which it begins: the head may jump.
    fn adopt(&mut self, params: CameraParams) -> Result<(), AdoptError> {
        self.script = Trajectory::new(params.motion.into(), params.seed, self.rest);
        Ok(())
    }

    fn capacities(params: &CameraParams) -> Vec<usize> {
        vec![params.image().pixels(), 1]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let begin = *self.begin.get_or_insert(activation.time);
        let now = activation.time.saturating_sub(begin);
        let seconds = now as f64 * 1e-9;
        let couch_from_head = match &self.phantom {
            Some(phantom) => phantom.couch_from_head(now, &self.rest),
            None => self.script.couch_from_head(seconds),
        };
        self.camera_view.send(&couch_from_head, seconds, activation, outputs, DEPTH)?;
        outputs.send::<Pose>(TRUTH, &exact_pose(&couch_from_head))
    }
}

impl From<Motion> for trajectory::Motion {
    fn from(motion: Motion) -> Self {
        match motion {
            Motion::Still => Self::Still,
            Motion::Steps => Self::Steps,
            Motion::Nods => Self::Nods,
            Motion::Sweep => Self::Sweep,
            Motion::Raise => Self::Raise,
        }
    }
}
