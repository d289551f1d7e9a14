//! `rig.camera`: the virtual rig as an operator. A depth image of the head at each tick, and where the head truly is.

use nalgebra::{Isometry3, Quaternion, Translation3, Unit};
use stillpoint_pipeline::frames::Rigid;
use stillpoint_pipeline::operator::{FrameRule, Kind, Output, Role, SetupError, StepError, Timer};
use stillpoint_pipeline::{Activation, Choice, Operator, Outputs, Params, Setup};
use stillpoint_samples::{DepthImage, Intrinsics, Pose, PoseElement, Sample};

use crate::camera::Pinhole;
use crate::head::Head;
use crate::noise::{DEPTH_UNIT_M, NoiseModel, NoiseParams};
use crate::render::Renderer;
use crate::sensor::DepthSensor;
use crate::setting;
use crate::trajectory::{self, Trajectory};

const DEPTH: usize = 0;
const TRUTH: usize = 1;
/// The frame in which the head's true pose is given.
const COUCH: &str = "couch";

/// What the head does.
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

/// What the head rests on and touches.
#[derive(Clone, Copy, Debug, Choice)]
pub enum Setting {
    /// A flat pad under the head and one at each side, which do not touch it.
    Pads,
    /// The pads at the sides are pressed against the head.
    TightPads,
    /// The head lies sunk into a soft pillow.
    Pillow,
    /// Shoulders and chest join the neck; the head lies on the flat pad.
    Shoulders,
    /// Shoulders, chest and pillow.
    Patient,
}

/// Whose errors the camera has.
#[derive(Clone, Copy, Debug, Choice)]
pub enum Noise {
    /// None but the 0.1 mm of a count.
    Exact,
    /// An industrial camera with projected texture.
    StructuredLight,
    /// A Kinect of the first kind.
    KinectV1,
    /// A Kinect of the second kind.
    KinectV2,
}

/// Parameters of `rig.camera`.
#[derive(Clone, Debug, Params)]
pub struct CameraParams {
    /// What the head does.
    #[param(default = "nods")]
    pub motion: Motion,
    /// Number that the head's script is drawn from. The camera's noise comes from the pipeline's seed.
    #[param(default = 7)]
    pub seed: u64,
    /// Whose errors the camera has.
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
    /// What the head rests on and touches.
    #[param(default = "pads")]
    pub setting: Setting,
    /// Size of the head; 1 is an adult's.
    #[param(default = 1, min = 0.5, max = 1.5)]
    pub head_scale: f64,
}

/// The rig's camera. Its `frame:` places it over the couch.
pub struct Camera {
    renderer: Renderer,
    sensor: DepthSensor,
    script: Trajectory,
    intrinsics: Intrinsics,
    /// Time of the first activation, ns: the script's zero.
    begin: Option<u64>,
}

impl Operator for Camera {
    type Params = CameraParams;
    const KIND: Kind = Kind {
        name: "rig.camera",
        about: "A head on a couch, moving by a script, as a depth camera sees it.",
        role: Role::Operator,
        inputs: &[],
        outputs: &[
            Output {
                name: "depth",
                sample: DepthImage::KIND,
                frame: FrameRule::Key,
                about: "What the camera measures, in counts of 0.1 mm.",
            },
            Output {
                name: "truth",
                sample: Pose::KIND,
                frame: FrameRule::Named(COUCH),
                about: "The head's true pose, couch_from_head; its origin lies between the ear canals.",
            },
        ],
        timer: Timer::Required,
    };

    fn new(params: CameraParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        let frame = setup.output_frames.first().and_then(Option::as_deref).unwrap_or_default();
        let couch_from_camera = setup.transform(COUCH, frame).ok_or_else(|| {
            SetupError(format!("place the frame `{frame}` in `frames` so that it hangs on `{COUCH}`"))
        })?;
        let (width, height) = (params.width, params.height);
        let (cx, cy) = ((f64::from(width) - 1.0) / 2.0, (f64::from(height) - 1.0) / 2.0);
        let focal = params.focal_length;
        let pinhole = Pinhole::new(focal, focal, cx, cy, width as usize, height as usize).map_err(refusal)?;
        let setting = setting::Setting::from(params.setting);
        let scene = setting.scene(params.head_scale).map_err(refusal)?;
        let head = Head::new(params.head_scale).map_err(refusal)?;
        let noise = NoiseModel::new(params.noise.into()).map_err(refusal)?;
        Ok(Self {
            renderer: Renderer::new(pinhole, &isometry(&couch_from_camera), &scene, head).map_err(refusal)?,
            sensor: DepthSensor::new(&pinhole, noise),
            script: Trajectory::new(params.motion.into(), params.seed, setting.rest(params.head_scale)),
            intrinsics: Intrinsics {
                fx: focal,
                fy: focal,
                cx,
                cy,
                depth_unit: DEPTH_UNIT_M,
                width,
                height,
                reserved: 0,
                length: width * height,
            },
            begin: None,
        })
    }

    fn capacities(params: &CameraParams) -> Vec<usize> {
        vec![params.width as usize * params.height as usize, 1]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let begin = *self.begin.get_or_insert(activation.time);
        let seconds = activation.time.saturating_sub(begin) as f64 * 1e-9;
        let couch_from_head = self.script.couch_from_head(seconds);
        let view = self.renderer.render(&couch_from_head).map_err(failure)?;
        let pixels = self.intrinsics.length as usize;
        let mut image = outputs.open::<DepthImage>(DEPTH, pixels)?;
        *image.body() = self.intrinsics;
        self.sensor.sense(view, &mut activation.random(), image.elements()).map_err(failure)?;
        image.finish(pixels)?;
        outputs.send::<Pose>(TRUTH, &exact_pose(&couch_from_head))
    }
}

fn refusal(error: impl std::fmt::Display) -> SetupError {
    SetupError(error.to_string())
}

fn failure(error: impl std::fmt::Display) -> StepError {
    StepError(error.to_string())
}

fn isometry(rigid: &Rigid) -> Isometry3<f64> {
    let [w, x, y, z] = rigid.quaternion();
    Isometry3::from_parts(
        Translation3::from(rigid.translation),
        Unit::new_normalize(Quaternion::new(w, x, y, z)),
    )
}

/// A pose that is known without error.
fn exact_pose(pose: &Isometry3<f64>) -> PoseElement {
    let q = pose.rotation.quaternion();
    // Both signs are the same rotation; a sample has one of them.
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    PoseElement {
        position: pose.translation.vector.into(),
        orientation: [q.w, q.i, q.j, q.k].map(|c| sign * c),
        covariance: [0.0; 36],
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

impl From<Setting> for setting::Setting {
    fn from(setting: Setting) -> Self {
        match setting {
            Setting::Pads => Self::Pads,
            Setting::TightPads => Self::TightPads,
            Setting::Pillow => Self::Pillow,
            Setting::Shoulders => Self::Shoulders,
            Setting::Patient => Self::Patient,
        }
    }
}

impl From<Noise> for NoiseParams {
    fn from(noise: Noise) -> Self {
        match noise {
            Noise::Exact => Self::exact(),
            Noise::StructuredLight => Self::structured_light(),
            Noise::KinectV1 => Self::kinect_v1(),
            Noise::KinectV2 => Self::kinect_v2(),
        }
    }
}
