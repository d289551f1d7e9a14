//! What a rig's camera gives at a moment: renderer, sensor and intrinsics as one.

use nalgebra::Isometry3;
use stillpoint_operator::{Activation, Choice, Outputs, Params, Setup};
use stillpoint_operator::{SetupError, StepError};
use stillpoint_samples::{DepthImage, Intrinsics, PoseElement};

use crate::camera::Pinhole;
use crate::head::Head;
use crate::noise::{DEPTH_UNIT_M, NoiseModel, NoiseParams};
use crate::person::{self, Expression, Person};
use crate::render::Renderer;
use crate::scene::{Label, Scene};
use crate::sensor::DepthSensor;
use crate::setting;
use crate::shape::{Ellipsoid, ShapeError};

/// The frame in which the head's true pose is given.
pub(crate) const COUCH: &str = "couch";

/// The objects that the head rests on and touches.
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

/// The camera whose noise is simulated.
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

/// The neck of the person.
#[derive(Clone, Copy, Debug, Choice)]
pub enum Neck {
    /// One block with the head, over a torso that stands still: a phantom.
    Rigid,
    /// Skin that bends between the head and the torso; the chest breathes.
    Skin,
}

/// An expression of the face.
#[derive(Clone, Copy, Debug, Choice)]
pub enum Act {
    /// Cheeks and corners of the mouth rise.
    Smile,
    /// The mouth opens.
    Jaw,
    /// The mouth opens and closes about four times a second.
    Talk,
    /// Throat and lips move.
    Swallow,
    /// Both eyes are shut.
    Blink,
    /// The brows rise.
    Brow,
}

/// An expression of the face and its time.
#[derive(Clone, Copy, Debug, Params)]
pub struct ExpressionParams {
    /// What the face does.
    pub act: Act,
    /// When it begins, after the start of the rig.
    #[param(unit = "ns")]
    pub at: u64,
    /// How long it takes, 0.35 s to come and 0.35 s to go among them.
    #[param(unit = "ns", default = "2 s", min = "100 ms", max = "1 h")]
    pub lasts: u64,
    /// Factor of the movement; 1 is a clear expression.
    #[param(default = 1, min = 0, max = 3)]
    pub strength: f64,
}

/// What moves of a person besides the skull.
#[derive(Clone, Debug)]
pub struct Living<'a> {
    pub neck: Neck,
    pub expressions: &'a [ExpressionParams],
    /// Where the skull lies at rest, `couch_from_head`.
    pub rest: Isometry3<f64>,
}

impl Living<'_> {
    /// The person, with the body of the scene; `None` where the head is one block.
    fn person(&self, head: &Head, scale: f64, scene: &mut Scene) -> Result<Option<Person>, ShapeError> {
        if matches!(self.neck, Neck::Rigid) && self.expressions.is_empty() {
            return Ok(None);
        }
        let expressions = self.expressions.iter().map(|e| e.expression()).collect();
        Person::new(head.clone(), scale, self.neck.into(), expressions, self.rest, scene).map(Some)
    }
}

impl ExpressionParams {
    fn expression(&self) -> Expression {
        let begin = self.at as f64 * 1e-9;
        let end = begin + self.lasts as f64 * 1e-9;
        Expression { act: self.act.into(), begin, end, strength: self.strength }
    }
}

/// The image that a camera makes.
#[derive(Clone, Copy, Debug, Params)]
pub struct ImageParams {
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
}

impl ImageParams {
    /// Pixels of an image.
    pub fn pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }
}

/// A camera over a head in its setting.
pub struct CameraView {
    renderer: Renderer,
    sensor: DepthSensor,
    intrinsics: Intrinsics,
    person: Option<Person>,
    parts: Vec<(Ellipsoid, Label)>,
    is_frozen: bool,
    /// The image that a frozen camera sends; empty before its first.
    retained: Vec<u16>,
}

impl CameraView {
    /// The camera whose place is the frame of output 0, over a head of this scale.
    ///
    /// # Errors
    /// A sentence that says what to change where frame, image or head cannot be.
    pub fn new(
        params: &ImageParams,
        setting: Setting,
        head_scale: f64,
        living: &Living<'_>,
        setup: &Setup<'_>,
    ) -> Result<Self, SetupError> {
        let frame = setup.output_frames.first().and_then(Option::as_deref).unwrap_or_default();
        let couch_from_camera = setup.transform(COUCH, frame).ok_or_else(|| {
            SetupError(format!("place the frame `{frame}` in `frames` so that it is connected to `{COUCH}`"))
        })?;
        let (width, height) = (params.width, params.height);
        let (cx, cy) = ((f64::from(width) - 1.0) / 2.0, (f64::from(height) - 1.0) / 2.0);
        let focal = params.focal_length;
        let pinhole = Pinhole::new(focal, focal, cx, cy, width as usize, height as usize).map_err(refusal)?;
        let mut scene = setting::Setting::from(setting).scene(head_scale).map_err(refusal)?;
        let head = Head::new(head_scale).map_err(refusal)?;
        let person = living.person(&head, head_scale, &mut scene).map_err(refusal)?;
        let noise = NoiseModel::new(params.noise.into()).map_err(refusal)?;
        Ok(Self {
            renderer: Renderer::new(pinhole, &stillpoint_pose::of_frame(&couch_from_camera), &scene, head)
                .map_err(refusal)?,
            sensor: DepthSensor::new(&pinhole, noise),
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
            person,
            parts: Vec::new(),
            is_frozen: false,
            retained: Vec::new(),
        })
    }

    /// Says whether the next image is to be sent again and again, whatever there is to be seen then.
    pub fn freeze(&mut self, is_frozen: bool) {
        self.is_frozen = is_frozen;
        if !is_frozen {
            self.retained.clear();
        }
    }

    /// Sends the image of the head at a pose, `seconds` after the start of the rig.
    ///
    /// # Errors
    /// A pose that is not finite, or an output that cannot hold the image.
    pub fn send(
        &mut self,
        couch_from_head: &Isometry3<f64>,
        seconds: f64,
        activation: &Activation<'_>,
        outputs: &mut Outputs<'_>,
        port: usize,
    ) -> Result<(), StepError> {
        let pixels = self.intrinsics.length as usize;
        let mut image = outputs.open::<DepthImage>(port, pixels)?;
        *image.body() = self.intrinsics;
        if !self.retained.is_empty() {
            image.elements().copy_from_slice(&self.retained);
            return image.finish(pixels);
        }
        let view = match &self.person {
            None => self.renderer.render(couch_from_head),
            Some(person) => {
                person.parts(couch_from_head, seconds, &mut self.parts);
                self.renderer.render_parts(&self.parts)
            }
        };
        let view = view.map_err(failure)?;
        self.sensor.sense(view, &mut activation.random(), image.elements()).map_err(failure)?;
        if self.is_frozen {
            self.retained.extend_from_slice(image.elements());
        }
        image.finish(pixels)
    }

    /// Sends an empty image.
    ///
    /// # Errors
    /// An output that cannot hold the image.
    pub fn send_blind(&self, outputs: &mut Outputs<'_>, port: usize) -> Result<(), StepError> {
        let pixels = self.intrinsics.length as usize;
        let mut image = outputs.open::<DepthImage>(port, pixels)?;
        *image.body() = self.intrinsics;
        image.elements().fill(0);
        image.finish(pixels)
    }
}

pub(crate) fn refusal(error: impl std::fmt::Display) -> SetupError {
    SetupError(error.to_string())
}

pub(crate) fn failure(error: impl std::fmt::Display) -> StepError {
    StepError(error.to_string())
}

/// A pose that is known without error.
pub(crate) fn exact_pose(pose: &Isometry3<f64>) -> PoseElement {
    stillpoint_pose::element(pose, [0.0; 36])
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

impl From<Neck> for person::Neck {
    fn from(neck: Neck) -> Self {
        match neck {
            Neck::Rigid => Self::Rigid,
            Neck::Skin => Self::Skin,
        }
    }
}

impl From<Act> for person::Act {
    fn from(act: Act) -> Self {
        match act {
            Act::Smile => Self::Smile,
            Act::Jaw => Self::Jaw,
            Act::Talk => Self::Talk,
            Act::Swallow => Self::Swallow,
            Act::Blink => Self::Blink,
            Act::Brow => Self::Brow,
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
