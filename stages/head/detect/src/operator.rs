//! `detect.face`: where grey images show faces.

use stillpoint_operator::{Activation, Choice, Operator, Outputs, Params, Setup};
use stillpoint_operator::{
    FrameRule, Input, Kind, Output, ParamConflict, Policy, Role, SetupError, StepError, Timer,
};
use stillpoint_samples::{FaceBox, FaceBoxes, FaceBoxesShape, GreyImage, Sample};

use crate::detector::{DetectParams, FaceDetector};
use crate::view;

const IMAGE: usize = 0;
const FACES: usize = 0;

/// Faces that are sent at most, the most certain ones.
const MAX_FACES: usize = 16;

/// Which way the top of the head points in the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum Top {
    /// Up: a person in front of the camera.
    Up,
    /// To the right.
    Right,
    /// Down: a patient on a couch, seen from the feet.
    Down,
    /// To the left.
    Left,
}

impl From<Top> for view::Top {
    fn from(top: Top) -> Self {
        match top {
            Top::Up => Self::Up,
            Top::Right => Self::Right,
            Top::Down => Self::Down,
            Top::Left => Self::Left,
        }
    }
}

/// Parameters of `detect.face`.
#[derive(Clone, Debug, Params)]
pub struct DetectFaceParams {
    /// Which way the top of the head points in the image. Heads that lean farther than about 30 degrees from it are not
    /// found.
    #[param(default = "up")]
    pub top: Top,
    /// Side of the smallest face in pixels. Images are reduced by a whole factor as far as this size allows, which is
    /// faster.
    #[param(default = 40, min = 40, max = 4000)]
    pub smallest: u32,
    /// Side of the largest face in pixels.
    #[param(default = 320, min = 40, max = 4000)]
    pub largest: u32,
    /// Smallest score of a face. Below 2 more false faces are found; above 4 more true faces are missed.
    #[param(default = 2, above = 0, max = 1000)]
    pub min_score: f64,
}

/// Sends the faces of each image; an empty list if there is no face.
pub struct DetectFace {
    detector: FaceDetector,
    params: DetectParams,
}

impl Operator for DetectFace {
    type Params = DetectFaceParams;
    const KIND: Kind = Kind {
        name: "detect.face",
        about: "Finds frontal faces in grey images, as boxes with scores.",
        role: Role::Operator,
        inputs: &[Input {
            name: "image",
            sample: GreyImage::KIND,
            policy: Policy::Queue(1),
            required: true,
            about: "The image.",
        }],
        outputs: &[Output {
            name: "faces",
            sample: FaceBoxes::KIND,
            frame: FrameRule::SameAs("image"),
            about: "The faces of each image, the most certain first; empty if there is no face.",
        }],
        timer: Timer::No,
    };

    fn validate(params: &DetectFaceParams) -> Result<(), ParamConflict> {
        let DetectFaceParams { smallest, largest, .. } = params;
        if largest >= smallest {
            return Ok(());
        }
        Err(ParamConflict {
            params: &["smallest", "largest"],
            reason: format!(
                "`largest` is {largest} pixels and must be at least `smallest`, {smallest} pixels"
            ),
            help: "raise `largest`, or lower `smallest`",
        })
    }

    fn new(params: DetectFaceParams, _: &Setup<'_>) -> Result<Self, SetupError> {
        let detector = FaceDetector::new()
            .map_err(|e| SetupError(format!("the face model in this program cannot be read: {e}")))?;
        let params = DetectParams {
            top: params.top.into(),
            smallest: params.smallest,
            largest: params.largest,
            least_score: params.min_score,
        };
        Ok(Self { detector, params })
    }

    fn capacities(_: &DetectFaceParams) -> Vec<usize> {
        vec![MAX_FACES]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let Some(image) = activation.input::<GreyImage>(IMAGE) else { return Ok(()) };
        let (width, height) = (image.body.width, image.body.height);
        if u64::from(width) * u64::from(height) != image.elements.len() as u64 {
            return Err(StepError(format!(
                "an image of {width} x {height} pixels came with {} of them",
                image.elements.len()
            )));
        }
        let mut faces = self.detector.find(image.elements, width as usize, &self.params);
        faces.truncate(MAX_FACES);
        let boxes: Vec<FaceBox> = faces
            .iter()
            .map(|face| FaceBox {
                score: face.score,
                left: face.area.left,
                top: face.area.top,
                width: face.area.width,
                height: face.area.height,
            })
            .collect();
        let shape = FaceBoxesShape { width, height, top: self.params.top as u32, length: boxes.len() as u32 };
        outputs.send_slice::<FaceBoxes>(FACES, &shape, &boxes)
    }
}
