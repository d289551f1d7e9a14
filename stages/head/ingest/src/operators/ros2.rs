//! `ingest.ros2`: the clouds or depth images of a topic of ROS 2.

use std::collections::BTreeMap;

use stillpoint_operator::outside::Arrivals;
use stillpoint_operator::ros2::Subscription;
use stillpoint_operator::{Activation, Choice, Files, Operator, Outputs, ParamConflict, Params, Setup};
use stillpoint_operator::{FrameRule, Kind, Output, Role, SetupError, StepError, Timer};
use stillpoint_ros2::TopicName;
use stillpoint_samples::{Diagnostics, PointCloud, Sample};

use super::messages::{Cameras, Form};
use super::playback::Pace;
use super::recording::{self, Play, Recording};
use super::turn::AtEnd;
use super::unit::Unit;
use crate::bag::{Reading, Selected};
use crate::camera_info::Image;
use crate::wire::{Accepted, Admission, Clock, Counts, Intake, WireRefusal};

const CLOUD: usize = 0;
const DIAGNOSTICS: usize = 1;
/// Bytes that a message may have beside its points or pixels.
const HEADROOM: usize = 4096;
/// The most bytes of a point: x, y, z, and colour or the like.
const POINT_BYTES: usize = 32;
/// The most bytes of a pixel.
const PIXEL_BYTES: usize = 4;

/// The type of the messages of a topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum MessageType {
    /// `sensor_msgs/msg/Image` with depth: 16UC1 in mm, or 32FC1 in m.
    Image,
    /// `sensor_msgs/msg/CompressedImage` with depth as PNG or RVL.
    Compressed,
    /// `sensor_msgs/msg/PointCloud2`.
    Cloud,
}

/// Which time is that of the acquisition of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum Stamps {
    /// The stamp in its header. The clocks of both machines must agree.
    Header,
    /// The time of its arrival, for senders whose stamps are of another clock.
    Arrival,
}

/// Parameters of `ingest.ros2`.
#[derive(Clone, Debug, Params)]
pub struct Ros2Params {
    /// Name of the topic of ROS 2, such as `/camera/depth/image_rect_raw`.
    pub topic: String,
    /// Type of its messages: `image` is depth as `sensor_msgs/msg/Image` (16UC1 in mm, 32FC1 in m), `compressed` depth as PNG or RVL in
    /// `sensor_msgs/msg/CompressedImage`, `cloud` `sensor_msgs/msg/PointCloud2`.
    pub messages: MessageType,
    /// Topic of the `sensor_msgs/msg/CameraInfo` of images. Without it: `camera_info` in the namespace of the image. The
    /// distortion `plumb_bob` or `rational_polynomial` is undone.
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
    /// Frame of the messages as ROS 2 names it: those of another frame are refused. Without it, all are taken.
    pub frame_id: Option<String>,
    /// Which time is that of the acquisition.
    #[param(default = "header")]
    pub stamps: Stamps,
    /// How far a stamp may be ahead of the clock of this machine: those farther ahead are refused.
    #[param(unit = "ns", default = "5 ms", max = "1 s")]
    pub clock_ahead: u64,
    /// An MCAP recording of the same topics, which a run that is not live plays in place of ROS 2, at its own pace. What
    /// the wire refuses, it refuses and counts, too; a message arrives at its time in the recording.
    #[param(files = "*")]
    pub recording: Option<String>,
    /// The longest time between two messages. A longer one shows that a clock was set while it was recorded.
    #[param(unit = "ns", default = "1 min", min = "1 ms", max = "24 h")]
    pub max_gap: u64,
    /// What follows the last message of the recording.
    #[param(default = "stop")]
    pub at_end: AtEnd,
    /// Largest number of points of a cloud, or of pixels of an image: sets the size of shared memory.
    #[param(default = 307200, min = 1, max = 16777216)]
    pub max_points: u32,
    /// Largest size of a message in bytes: sets the size of shared memory. Without it: 4 bytes per pixel, 32 per point, and
    /// 4096.
    #[param(min = 64, max = 1073741824)]
    pub max_bytes: Option<u32>,
}

impl Ros2Params {
    fn type_name(&self) -> &'static str {
        match self.messages {
            MessageType::Image => "sensor_msgs/msg/Image",
            MessageType::Compressed => "sensor_msgs/msg/CompressedImage",
            MessageType::Cloud => "sensor_msgs/msg/PointCloud2",
        }
    }

    fn reading(&self) -> Reading {
        match self.messages {
            MessageType::Image => Reading::Image,
            MessageType::Compressed => Reading::Compressed,
            MessageType::Cloud => Reading::Cloud,
        }
    }

    /// The topic of the camera of images.
    fn camera_topic(&self) -> Option<String> {
        if self.messages == MessageType::Cloud {
            return None;
        }
        let sibling = || {
            // A transport stands behind the name of the image.
            let image = match self.topic.rsplit_once('/') {
                Some((image, "compressedDepth" | "compressed")) => image,
                _ => &self.topic,
            };
            Some(TopicName::parse(image).ok()?.sibling("camera_info").ok()?.as_str().to_owned())
        };
        self.camera_info.clone().or_else(sibling)
    }

    fn longest(&self) -> usize {
        let each = if self.messages == MessageType::Cloud { POINT_BYTES } else { PIXEL_BYTES };
        self.max_bytes.map_or(self.max_points as usize * each + HEADROOM, |bytes| bytes as usize)
    }

    fn selected(&self) -> Selected<'_> {
        Selected {
            topic: &self.topic,
            // As it is recorded, it may stand beside the image in two ways.
            camera_info: self.camera_info.as_deref(),
            skip: 0,
            frames: None,
        }
    }

    fn clock(&self) -> Clock {
        match self.stamps {
            Stamps::Header => Clock::Stamp { ahead: self.clock_ahead },
            Stamps::Arrival => Clock::Arrival,
        }
    }

    fn form(&self) -> Form {
        Form { reading: self.reading(), unit: self.unit, depth_unit: self.depth_unit }
    }

    /// How the recording is played in place of the wire.
    fn play(&self) -> Play<'_> {
        Play {
            form: self.form(),
            pace: Pace::Recorded,
            at_end: self.at_end,
            max_gap: self.max_gap,
            image: self.image,
            max_points: self.max_points as usize,
            strict: false,
            wire: Some(Admission { frame: self.frame_id.as_deref(), clock: self.clock() }),
        }
    }

    fn intake(&self) -> Intake {
        let cameras = Cameras::of_topic(&self.topic, self.image, self.max_points as usize);
        Intake::new(self.messages != MessageType::Cloud, self.clock(), self.frame_id.clone(), cameras)
    }
}

/// Sends the messages of a topic of ROS 2 as clouds.
pub struct IngestRos2 {
    form: Form,
    from: From,
}

/// Where the messages come from.
enum From {
    /// ROS 2.
    Wire { arrivals: Arrivals, intake: Box<Intake> },
    /// A recording, where the run is not live.
    Recording { recording: Box<Recording>, counts: Counts },
}

impl Operator for IngestRos2 {
    type Params = Ros2Params;
    const KIND: Kind = Kind {
        name: "ingest.ros2",
        about: "Takes the clouds or depth images of a topic of ROS 2. The section `ros2` names the router.",
        role: Role::Source,
        inputs: &[],
        outputs: &[
            Output {
                name: "cloud",
                sample: PointCloud::KIND,
                frame: FrameRule::Key,
                about: "The cloud of the message, organised if the message is; of an image, a point per pixel in the camera's frame: x right, y down, z forward.",
            },
            Output {
                name: "diagnostics",
                sample: Diagnostics::KIND,
                frame: FrameRule::None,
                about: "After each message: how many became clouds, were refused, by reason, or are missing.",
            },
        ],
        timer: Timer::Required,
    };

    fn validate(params: &Ros2Params) -> Result<(), ParamConflict> {
        let is_name = |text: &str| TopicName::parse(text).map_err(|reason| format!("{text}: {reason}"));
        let named = is_name(&params.topic)
            .and_then(|_| params.camera_info.as_deref().map_or(Ok(()), |t| is_name(t).map(drop)));
        named.map_err(|reason| ParamConflict {
            params: &["topic", "camera_info"],
            reason: format!("a topic of ROS 2 has another name: {reason}"),
            help: "write the name as `ros2 topic list` has it",
        })?;
        if params.messages == MessageType::Cloud && params.camera_info.is_some() {
            return Err(ParamConflict {
                params: &["camera_info"],
                reason: "clouds need no `camera_info`".to_string(),
                help: "remove it",
            });
        }
        if params.camera_topic().as_deref() == Some(&params.topic) {
            return Err(ParamConflict {
                params: &["topic", "camera_info"],
                reason: format!("{} is the topic of the images and of their camera", params.topic),
                help: "name the topic of the images",
            });
        }
        Ok(())
    }

    fn check_files(params: &Ros2Params, files: &dyn Files) -> Result<(), ParamConflict> {
        let Some(file) = &params.recording else { return Ok(()) };
        let refused = |reason: &dyn std::fmt::Display| ParamConflict {
            params: &["recording", "topic", "messages", "camera_info"],
            reason: format!("{file}: {reason}"),
            help: "name a recording in MCAP with the same topics, as `ros2 bag info` lists them",
        };
        match recording::check(files, file, &params.topic, params.camera_info.as_deref()) {
            Ok(Some(reading)) if reading != params.reading() => {
                let (topic, name) = (&params.topic, params.type_name());
                Err(refused(&format_args!("its messages on {topic} are not {name}")))
            }
            Ok(_) => Ok(()),
            Err(error) => Err(refused(&error)),
        }
    }

    fn cut_files(params: &[&Ros2Params], files: &dyn Files) -> Result<BTreeMap<String, Vec<u8>>, SetupError> {
        let selected =
            params.iter().filter_map(|params| Some((params.recording.as_deref()?, params.selected())));
        recording::cut(&selected.collect::<Vec<_>>(), files)
    }

    fn subscriptions(params: &Ros2Params) -> Vec<Subscription> {
        let longest = params.longest();
        let of =
            |topic: String, type_name: &str| Subscription { topic, type_name: type_name.to_owned(), longest };
        let mut all = vec![of(params.topic.clone(), params.type_name())];
        all.extend(params.camera_topic().map(|topic| of(topic, "sensor_msgs/msg/CameraInfo")));
        all
    }

    fn new(params: Ros2Params, setup: &Setup<'_>) -> Result<Self, SetupError> {
        let form = params.form();
        if let Some(arrivals) = setup.outside.arrivals.clone() {
            return Ok(Self { form, from: From::Wire { arrivals, intake: Box::new(params.intake()) } });
        }
        let Some(file) = &params.recording else {
            return Err(SetupError(format!(
                "`{}` takes {} of ROS 2, which a live run alone does: set `recording` to a recording of the topic, which any \
                 other run plays",
                setup.operator, params.topic
            )));
        };
        let read = Recording::open(setup.files, file, &params.selected(), &params.play());
        let recording = Box::new(read.map_err(|e| SetupError(format!("{file}: {e}")))?);
        Ok(Self { form, from: From::Recording { recording, counts: Counts::default() } })
    }

    fn remarks(params: &Ros2Params, files: &dyn Files) -> Vec<String> {
        let of = |file: &String| recording::remarks(files, file, &params.selected(), &params.play());
        params.recording.as_ref().map_or_else(Vec::new, of)
    }

    fn finishes(params: &Ros2Params) -> bool {
        params.recording.is_some() && params.at_end == AtEnd::Stop
    }

    fn capacities(params: &Ros2Params) -> Vec<usize> {
        vec![params.max_points as usize, Counts::METRICS]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        match &mut self.from {
            From::Recording { recording, counts } => {
                match recording.play(activation.time, CLOUD, Some(counts), outputs)? {
                    true => outputs.send_slice::<Diagnostics>(DIAGNOSTICS, &(), &counts.metrics()),
                    false => Ok(()),
                }
            }
            From::Wire { arrivals, intake } => {
                // One at a time: each has its own time of acquisition.
                let Some(bytes) = arrivals.take() else { return Ok(()) };
                let sent = take(&self.form, intake, &bytes, activation.time, outputs);
                arrivals.give_back(bytes);
                sent
            }
        }
    }
}

/// Makes a cloud of what the bridge handed over, and tells the counts.
fn take(
    form: &Form,
    intake: &mut Intake,
    bytes: &[u8],
    now: u64,
    outputs: &mut Outputs<'_>,
) -> Result<(), StepError> {
    if let Ok(Some(Accepted { message, camera, acquired })) = intake.accept(bytes, now) {
        let made = form.send(message, intake.cameras().get(camera), CLOUD, outputs);
        match made.as_ref().map_err(WireRefusal::of) {
            Ok(()) => {
                outputs.acquired_at(acquired);
                intake.counts.clouds += 1;
            }
            Err(Some(refusal)) => intake.counts.refuse(refusal),
            Err(None) => return made.map_err(|e| StepError(e.to_string())),
        }
    }
    outputs.send_slice::<Diagnostics>(DIAGNOSTICS, &(), &intake.counts.metrics())
}
