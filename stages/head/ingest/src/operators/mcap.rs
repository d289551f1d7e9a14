//! `ingest.mcap`: the clouds or depth images of a topic of a recording of ROS 2.

use std::collections::BTreeMap;

use stillpoint_operator::{Activation, Files, Operator, Outputs, ParamConflict, Params, Setup};
use stillpoint_operator::{FrameRule, Kind, Output, Role, SetupError, StepError, Timer};
use stillpoint_samples::{PointCloud, Sample};

use super::messages::Form;
use super::playback::Pace;
use super::recording::{self, Play, Recording};
use super::turn::AtEnd;
use super::unit::Unit;
use crate::bag::{Reading, Selected};
use crate::camera_info::Image;

const CLOUD: usize = 0;

/// Parameters of `ingest.mcap`.
#[derive(Clone, Debug, Params)]
pub struct McapParams {
    /// An MCAP recording of ROS 2 messages: one file, or a folder of rosbag2 or of a session. A session keeps of it only
    /// the messages that are read.
    #[param(files = "*")]
    pub file: String,
    /// Topic of `sensor_msgs/msg/PointCloud2`, of depth as `sensor_msgs/msg/Image` (16UC1 in mm, 32FC1 in m) or of depth
    /// as PNG or RVL in `sensor_msgs/msg/CompressedImage`. Of a session, its own name (`cloud.cloud`) or that of ROS 2
    /// (`/cloud/cloud`).
    pub topic: String,
    /// Topic of the `sensor_msgs/msg/CameraInfo` of images. Without it: `camera_info` in the namespace of the image, or
    /// below the image. The distortion `plumb_bob` or `rational_polynomial` is undone.
    pub camera_info: Option<String>,
    /// Depth of a count of images of 16 bits: 1 mm without it, as 16UC1 has it; 0.25 mm for some cameras. If it is set,
    /// pixels of `mono16` are depths, too.
    #[param(unit = "m", above = "0 mm", max = "100 mm")]
    pub depth_unit: Option<f64>,
    /// Unit of the coordinates of clouds.
    #[param(default = "m")]
    pub unit: Unit,
    /// Whether images are raw or rectified. Without it: rectified where the name of the image has the word `rect` or
    /// `rectified`, as `image_rect`; the projection P is used then, and no distortion.
    pub image: Option<Image>,
    /// When a message is sent. `run --clock simulated` plays a recording as fast as the machine goes, at either pace.
    #[param(default = "ticks")]
    pub pace: Pace,
    /// The longest time between two messages. A longer one shows that a clock was set while it was recorded.
    #[param(unit = "ns", default = "1 min", min = "1 ms", max = "24 h")]
    pub max_gap: u64,
    /// Refuses damaged messages. Without it, they are left out and counted at the end of the run.
    #[param(default = false)]
    pub strict: bool,
    /// Number of messages to skip at the beginning, in the order of their log times.
    #[param(default = 0)]
    pub skip: u32,
    /// Largest number of messages to read; without this parameter, all. They are held in memory.
    #[param(min = 1)]
    pub frames: Option<u32>,
    /// What follows the last message.
    #[param(default = "stop")]
    pub at_end: AtEnd,
    /// Largest number of points of a cloud, or of pixels of an image: sets the size of shared memory.
    #[param(default = 307200, min = 1, max = 16777216)]
    pub max_points: u32,
}

/// Sends the messages of a recording as clouds, in the order of their log times.
pub struct IngestMcap(Recording);

impl Operator for IngestMcap {
    type Params = McapParams;
    const KIND: Kind = Kind {
        name: "ingest.mcap",
        about: "Reads the clouds or depth images of an MCAP recording of ROS 2.",
        role: Role::Operator,
        inputs: &[],
        outputs: &[Output {
            name: "cloud",
            sample: PointCloud::KIND,
            frame: FrameRule::Key,
            about: "The cloud of the message, organised if the message is; of an image, a point per pixel in the camera's frame: x right, y down, z forward.",
        }],
        timer: Timer::Required,
    };

    fn check_files(params: &McapParams, files: &dyn Files) -> Result<(), ParamConflict> {
        let checked = recording::check(files, &params.file, &params.topic, params.camera_info.as_deref());
        checked.map(drop).map_err(|reason| ParamConflict {
            params: &["file", "topic", "camera_info"],
            reason: format!("{}: {reason}", params.file),
            help: "name a recording in MCAP, and a topic of it as `ros2 bag info` lists them",
        })
    }

    fn cut_files(params: &[&McapParams], files: &dyn Files) -> Result<BTreeMap<String, Vec<u8>>, SetupError> {
        let selected: Vec<_> = params.iter().map(|params| (params.file.as_str(), selected(params))).collect();
        recording::cut(&selected, files)
    }

    fn remarks(params: &McapParams, files: &dyn Files) -> Vec<String> {
        recording::remarks(files, &params.file, &selected(params), &play(params))
    }

    fn new(params: McapParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        let read = Recording::open(setup.files, &params.file, &selected(&params), &play(&params));
        let read = read.map_err(|e| SetupError(format!("{}: {e}", params.file)))?;
        match (params.pace, read.period(), setup.every) {
            (Pace::Recorded, Some(period), Some(every)) if every > period => Err(SetupError(format!(
                "{}: its messages come every {:.1} ms, and a tick sends one: lower `every` to that at most",
                params.file,
                period as f64 / 1e6
            ))),
            _ => Ok(Self(read)),
        }
    }

    fn finishes(params: &McapParams) -> bool {
        params.at_end == AtEnd::Stop
    }

    fn capacities(params: &McapParams) -> Vec<usize> {
        vec![params.max_points as usize]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        self.0.play(activation.time, CLOUD, None, outputs).map(drop)
    }
}

fn selected(params: &McapParams) -> Selected<'_> {
    Selected {
        topic: &params.topic,
        camera_info: params.camera_info.as_deref(),
        skip: params.skip as usize,
        frames: params.frames.map(|frames| frames as usize),
    }
}

fn play(params: &McapParams) -> Play<'static> {
    Play {
        // The recording says what its messages are.
        form: Form { reading: Reading::Cloud, unit: params.unit, depth_unit: params.depth_unit },
        pace: params.pace,
        at_end: params.at_end,
        max_gap: params.max_gap,
        image: params.image,
        max_points: params.max_points as usize,
        strict: params.strict,
        wire: None,
    }
}
