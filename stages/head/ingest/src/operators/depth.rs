//! `ingest.depth`: depth images, from another operator or from PNG files, to organised clouds.

use stillpoint_operator::{Activation, Files, Operator, Outputs, Params, Setup};
use stillpoint_operator::{FrameRule, Input, Kind, Output, Policy, Role, SetupError, StepError, Timer};
use stillpoint_samples::{self as samples, DepthImage, PointCloud, Sample};

use super::files::{self, RecordedFile};
use super::points::send_cloud;
use super::turn::{AtEnd, Turn};
use crate::checks::{self, Fault, Scale};
use crate::depth::{Intrinsics, decode_png, deproject};

const IMAGE: usize = 0;
const CLOUD: usize = 0;

/// Parameters of `ingest.depth`.
#[derive(Clone, Debug, Params)]
pub struct DepthParams {
    /// 16-bit PNGs, in the order of their names, in place of the input `image`: one file, a folder, or a pattern such
    /// as `scans/left_*.png`.
    #[param(files = "*.png")]
    pub files: Option<String>,
    /// The camera of the files; an image from the input has its own intrinsics.
    pub camera: Option<CameraParams>,
    /// What follows the last file.
    #[param(default = "stop")]
    pub at_end: AtEnd,
    /// Refuses damaged files. Without it, they are left out and counted at the end of the run.
    #[param(default = false)]
    pub strict: bool,
    /// Largest number of pixels of an image: sets the size of shared memory.
    #[param(default = 307200, min = 1, max = 16777216)]
    pub max_pixels: u32,
}

/// A camera without distortion.
#[derive(Clone, Debug, Params)]
pub struct CameraParams {
    /// Focal length along a row.
    #[param(unit = "px", min = "1 px", max = "100000 px")]
    pub fx: f64,
    /// Focal length along a column.
    #[param(unit = "px", min = "1 px", max = "100000 px")]
    pub fy: f64,
    /// Column of the principal point; the first pixel's middle is 0.
    #[param(unit = "px", min = "-100000 px", max = "100000 px")]
    pub cx: f64,
    /// Row of the principal point; the first pixel's middle is 0.
    #[param(unit = "px", min = "-100000 px", max = "100000 px")]
    pub cy: f64,
    /// Depth of one count: 0.1 mm for this project's rig, 1 mm for most depth cameras.
    #[param(unit = "m", default = "1 mm", above = "0 mm", max = "100 mm")]
    pub depth_unit: f64,
}

/// Deprojects each image straight into the cloud's buffer.
pub struct IngestDepth(Source);

enum Source {
    /// Images come in.
    Port,
    /// Images are files.
    Files {
        /// Compressed as they are on disk: a long recording would not fit into memory otherwise.
        files: Vec<RecordedFile>,
        turn: Turn,
        camera: Intrinsics,
    },
}

impl Operator for IngestDepth {
    type Params = DepthParams;
    const KIND: Kind = Kind {
        name: "ingest.depth",
        about: "Converts depth images, from an operator or from PNG files, to organised clouds.",
        role: Role::Operator,
        inputs: &[Input {
            name: "image",
            sample: DepthImage::KIND,
            policy: Policy::Queue(2),
            required: false,
            about: "The image with its intrinsics; without it, `files` are read, one per tick.",
        }],
        outputs: &[Output {
            name: "cloud",
            sample: PointCloud::KIND,
            frame: FrameRule::Key,
            about: "The cloud in the camera's frame: x right, y down, z forward.",
        }],
        timer: Timer::Optional,
    };

    fn new(params: DepthParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        let refuse = |reason: &str| Err(SetupError(reason.to_string()));
        match (setup.is_connected(IMAGE), &params.files, &params.camera) {
            (true, Some(_), _) => refuse("it has both `image` and `files`: remove one of them"),
            (true, None, Some(_)) => refuse("an image has its own intrinsics: remove `camera`"),
            (true, None, None) if setup.every.is_some() => {
                refuse("it runs when an image arrives: remove `every`")
            }
            (true, None, None) => from_port(setup),
            (false, None, _) => refuse("it has neither `image` nor `files`: connect or name one of them"),
            (false, Some(_), None) => refuse("its files have no intrinsics: add `camera` to its `params`"),
            (false, Some(place), Some(camera)) => from_files(&params, place, camera, setup),
        }
        .map(Self)
    }

    fn remarks(params: &DepthParams, files: &dyn Files) -> Vec<String> {
        let (Some(place), Some(camera)) = (&params.files, &params.camera) else { return Vec::new() };
        let camera = pinhole(camera);
        files::remarks(files, place, params.strict, |file| look(params, &camera, file))
    }

    fn finishes(params: &DepthParams) -> bool {
        params.files.is_some() && params.at_end == AtEnd::Stop
    }

    fn capacities(params: &DepthParams) -> Vec<usize> {
        vec![params.max_pixels as usize]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        match &mut self.0 {
            Source::Port => match activation.input::<DepthImage>(IMAGE) {
                Some(image) => send(image.elements, image.body, outputs),
                None => Ok(()),
            },
            Source::Files { files, turn, camera } => match turn.take() {
                Some(frame) => send_file(&files[frame], camera, outputs),
                None => {
                    outputs.finish();
                    Ok(())
                }
            },
        }
    }
}

fn from_port(setup: &Setup<'_>) -> Result<Source, SetupError> {
    let frame = |frames: &[Option<String>]| frames.first().cloned().flatten();
    match (frame(setup.input_frames), frame(setup.output_frames)) {
        (Some(image), Some(cloud)) if image != cloud => Err(SetupError(format!(
            "its image is in the frame `{image}` and a cloud stays where its image is: write `frame: {image}`"
        ))),
        _ => Ok(Source::Port),
    }
}

fn from_files(
    params: &DepthParams,
    place: &str,
    camera: &CameraParams,
    setup: &Setup<'_>,
) -> Result<Source, SetupError> {
    let camera = pinhole(camera);
    let files = files::read(setup, place, params.strict, |file| look(params, &camera, file))?;
    let files: Vec<RecordedFile> = files.into_iter().map(|(file, ())| file).collect();
    Ok(Source::Files { turn: Turn::new(files.len(), params.at_end), files, camera })
}

fn send(counts: &[u16], camera: &samples::Intrinsics, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
    let pinhole = Intrinsics {
        fx: camera.fx,
        fy: camera.fy,
        cx: camera.cx,
        cy: camera.cy,
        metres_per_count: camera.depth_unit,
    };
    let (width, height) = (camera.width as usize, camera.height as usize);
    checks::camera(&pinhole, width, height)
        .map_err(|e| StepError(format!("the intrinsics of an image are not those of a camera: {e}")))?;
    deproject_into(counts, width, height, &pinhole, outputs)
}

/// The camera of the parameters.
fn pinhole(camera: &CameraParams) -> Intrinsics {
    let CameraParams { fx, fy, cx, cy, depth_unit: metres_per_count } = *camera;
    Intrinsics { fx, fy, cx, cy, metres_per_count }
}

/// Looks at a file as a step does.
fn look(params: &DepthParams, camera: &Intrinsics, file: &RecordedFile) -> Result<(), Fault> {
    let image = decode_png(&file.bytes).map_err(|e| Fault::Item(e.to_string()))?;
    files::at_most(params.max_pixels, image.counts.len(), "pixels", "max_pixels")?;
    checks::camera(camera, image.width, image.height)?;
    let mut points = vec![[0.0; 3]; image.counts.len()];
    deproject(&image.counts, image.width, image.height, camera, &mut points)
        .map_err(|e| Fault::Item(e.to_string()))?;
    Ok(checks::scale(points, Scale::Depths)?)
}

fn send_file(file: &RecordedFile, camera: &Intrinsics, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
    let image = decode_png(&file.bytes).map_err(|e| StepError(format!("{}: {e}", file.name)))?;
    deproject_into(&image.counts, image.width, image.height, camera, outputs)
}

fn deproject_into(
    counts: &[u16],
    width: usize,
    height: usize,
    camera: &Intrinsics,
    outputs: &mut Outputs<'_>,
) -> Result<(), StepError> {
    send_cloud(outputs, CLOUD, width, height, |points| {
        deproject(counts, width, height, camera, points).map_err(|e| StepError(e.to_string()))
    })
}
