//! `ingest.grey`: grey images out of PNG files, one per tick.

use stillpoint_operator::{Activation, Files, Operator, Outputs, Params, Setup};
use stillpoint_operator::{FrameRule, Kind, Output, Role, SetupError, StepError, Timer};
use stillpoint_samples::{GreyImage, GreyShape, Sample};

use super::files::{self, RecordedFile};
use super::turn::{AtEnd, Turn};
use crate::checks::Fault;
use crate::grey::decode_png;

const IMAGE: usize = 0;

/// Parameters of `ingest.grey`.
#[derive(Clone, Debug, Params)]
pub struct GreyParams {
    /// 8-bit greyscale PNGs, in the order of their names: one file, a folder, or a pattern such as `scans/left_*.png`.
    #[param(files = "*.png")]
    pub files: String,
    /// What follows the last file.
    #[param(default = "stop")]
    pub at_end: AtEnd,
    /// Refuses damaged files. Without it, they are left out and counted at the end of the run.
    #[param(default = false)]
    pub strict: bool,
    /// Largest number of pixels of an image: sets the size of shared memory.
    #[param(default = 1310720, min = 1, max = 16777216)]
    pub max_pixels: u32,
}

/// Sends the image of one file per tick.
pub struct IngestGrey {
    /// As they are on disk: compressed ones stay small.
    files: Vec<RecordedFile>,
    turn: Turn,
}

impl Operator for IngestGrey {
    type Params = GreyParams;
    const KIND: Kind = Kind {
        name: "ingest.grey",
        about: "Reads grey images from PNG files, one per tick.",
        role: Role::Operator,
        inputs: &[],
        outputs: &[Output {
            name: "image",
            sample: GreyImage::KIND,
            frame: FrameRule::Key,
            about: "The image, in the frame of its camera.",
        }],
        timer: Timer::Required,
    };

    fn new(params: GreyParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        let files = files::read(setup, &params.files, params.strict, |file| look(&params, file))?;
        let files: Vec<RecordedFile> = files.into_iter().map(|(file, ())| file).collect();
        Ok(Self { turn: Turn::new(files.len(), params.at_end), files })
    }

    fn remarks(params: &GreyParams, files: &dyn Files) -> Vec<String> {
        files::remarks(files, &params.files, params.strict, |file| look(params, file))
    }

    fn finishes(params: &GreyParams) -> bool {
        params.at_end == AtEnd::Stop
    }

    fn capacities(params: &GreyParams) -> Vec<usize> {
        vec![params.max_pixels as usize]
    }

    fn step(&mut self, _: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let Some(frame) = self.turn.take() else {
            outputs.finish();
            return Ok(());
        };
        let file = &self.files[frame];
        let image = decode_png(&file.bytes).map_err(|e| StepError(format!("{}: {e}", file.name)))?;
        let length = image.pixels.len() as u32;
        let shape = GreyShape { width: image.width as u32, height: image.height as u32, reserved: 0, length };
        outputs.send_slice::<GreyImage>(IMAGE, &shape, &image.pixels)
    }
}

/// Looks at a file as a step does.
fn look(params: &GreyParams, file: &RecordedFile) -> Result<(), Fault> {
    let image = decode_png(&file.bytes).map_err(|e| Fault::Item(e.to_string()))?;
    files::at_most(params.max_pixels, image.pixels.len(), "pixels", "max_pixels")
}
