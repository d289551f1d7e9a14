//! `ingest.mcap`: the clouds or depth images of a topic of a recording of ROS 2.

use std::collections::{BTreeMap, BTreeSet};

use stillpoint_cdr::Reader;
use stillpoint_operator::{Activation, Files, Operator, Outputs, ParamConflict, Params, Setup};
use stillpoint_operator::{FrameRule, Kind, Output, Role, SetupError, StepError, Timer};
use stillpoint_samples::{PointCloud, Sample};

use super::playback::{Due, Pace, Playback};
use super::points::send_cloud;
use super::turn::AtEnd;
use crate::bag::{self, At, Bag, OpenError, Reading, Selection, Wanted};
use crate::camera_info::{CameraInfo, Image};
use crate::depth_message::DepthMessage;
use crate::point_cloud2::PointCloud2;

const CLOUD: usize = 0;
/// Largest size of all messages together: 1 GiB.
const MOST_BYTES: usize = 1 << 30;
/// The most different cameras of a topic: the rays of each are held in memory.
const MOST_CAMERAS: usize = 16;

/// Parameters of `ingest.mcap`.
#[derive(Clone, Debug, Params)]
pub struct McapParams {
    /// An MCAP recording of ROS 2 messages: one file, or a folder of rosbag2 or of a session. A session keeps of it only
    /// the messages that are read.
    #[param(files = "*")]
    pub file: String,
    /// Topic of `sensor_msgs/msg/PointCloud2`, of depth as `sensor_msgs/msg/Image` (16UC1 in mm, 32FC1 in m) or of depth
    /// as PNG in `sensor_msgs/msg/CompressedImage`. Of a session, its own name (`cloud.cloud`) or that of ROS 2
    /// (`/cloud/cloud`).
    pub topic: String,
    /// Topic of the `sensor_msgs/msg/CameraInfo` of images. Without it: `camera_info` in the namespace of the image, or
    /// below the image. The distortion `plumb_bob` or `rational_polynomial` is undone; an image whose name has `rect` is
    /// rectified already.
    pub camera_info: Option<String>,
    /// When a message is sent. `run --clock simulated` plays a recording as fast as the machine goes, at either pace.
    #[param(default = "ticks")]
    pub pace: Pace,
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
pub struct IngestMcap {
    reading: Reading,
    /// Each message as it was recorded, and the number of its camera.
    frames: Vec<(Vec<u8>, usize)>,
    cameras: Vec<Camera>,
    playback: Playback,
}

/// The rays of the pixels of images of one size.
struct Camera {
    size: [u32; 2],
    rays: Vec<[f64; 2]>,
}

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
        let checked = match Bag::open(files, &params.file) {
            Ok(bag) => bag::check(&bag, &params.topic, params.camera_info.as_deref()).map(|_| ()),
            // A replay goes on without the operators whose files its session lost.
            Err(OpenError::Unreadable(_)) => Ok(()),
            Err(OpenError::Other(reason)) => Err(reason),
        };
        checked.map_err(|reason| ParamConflict {
            params: &["file", "topic", "camera_info"],
            reason: format!("{}: {reason}", params.file),
            help: "name a recording in MCAP, and a topic of it as `ros2 bag info` lists them",
        })
    }

    fn cut_files(params: &[&McapParams], files: &dyn Files) -> Result<BTreeMap<String, Vec<u8>>, SetupError> {
        let mut by_place = BTreeMap::<&str, Vec<&McapParams>>::new();
        for params in params {
            by_place.entry(&params.file).or_default().push(params);
        }
        let (mut cut, mut seen, mut twice) = (BTreeMap::new(), BTreeSet::new(), BTreeSet::new());
        for (place, params) in by_place {
            let fault = |e: String| SetupError(format!("{place}: {e}"));
            let bag = Bag::open(files, place).map_err(|e| fault(e.to_string()))?;
            let selections: Result<Vec<Selection>, String> =
                params.iter().map(|params| bag::select(&bag, &wanted(params))).collect();
            let parts = bag::cut(&bag, &selections.map_err(fault)?).map_err(fault)?;
            for ((name, part), (_, whole)) in parts.into_iter().zip(&bag.files) {
                if !seen.insert(name.clone()) {
                    twice.insert(name);
                } else if part.len() < whole.len() {
                    // Else the compression of the whole is the better one.
                    cut.insert(name, part);
                }
            }
        }
        // A file that is named by its own name and by that of its folder stays whole.
        cut.retain(|name, _| !twice.contains(name));
        Ok(cut)
    }

    fn new(params: McapParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        let bag = Bag::open(setup.files, &params.file).map_err(|e| e.to_string());
        let read = bag.and_then(|bag| read(&bag, &params));
        let read = read.map_err(|e| SetupError(format!("{}: {e}", params.file)))?;
        match (params.pace, read.playback.period(), setup.every) {
            (Pace::Recorded, Some(period), Some(every)) if every > period => Err(SetupError(format!(
                "{}: its messages come every {:.1} ms, and a tick sends one: lower `every` to that at most",
                params.file,
                period as f64 / 1e6
            ))),
            _ => Ok(read),
        }
    }

    fn capacities(params: &McapParams) -> Vec<usize> {
        vec![params.max_points as usize]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        match self.playback.at(activation.time) {
            Due::Wait => Ok(()),
            Due::End => {
                outputs.finish();
                Ok(())
            }
            Due::Frame(number, time) => {
                if let Some(time) = time {
                    outputs.acquired_at(time);
                }
                self.send(number, outputs)
            }
        }
    }
}

impl IngestMcap {
    fn send(&self, number: usize, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let (bytes, camera) = &self.frames[number];
        if self.reading == Reading::Cloud {
            let cloud = PointCloud2::parse(bytes).map_err(|e| StepError(e.to_string()))?;
            return send_cloud(outputs, CLOUD, cloud.width(), cloud.height(), |points| {
                points.iter_mut().zip(cloud.points()).for_each(|(to, from)| *to = from);
                Ok(())
            });
        }
        let Camera { size, rays } = &self.cameras[*camera];
        let image = image(self.reading, bytes).map_err(|e| StepError(e.to_string()))?;
        send_cloud(outputs, CLOUD, size[0] as usize, size[1] as usize, |points| {
            image.points_into(*size, rays, points).map_err(|e| StepError(e.to_string()))
        })
    }
}

fn image(reading: Reading, bytes: &[u8]) -> Result<DepthMessage<'_>, String> {
    let image = match reading {
        Reading::Compressed => DepthMessage::parse_compressed(bytes),
        _ => DepthMessage::parse(bytes),
    };
    image.map_err(|e| e.to_string())
}

fn wanted(params: &McapParams) -> Wanted<'_> {
    Wanted {
        topic: &params.topic,
        camera_info: params.camera_info.as_deref(),
        skip: params.skip as usize,
        frames: params.frames.map(|frames| frames as usize),
    }
}

/// Reads the messages that the parameters select, and looks at each as a step does.
fn read(bag: &Bag, params: &McapParams) -> Result<IngestMcap, String> {
    let Selection { reading, frames, .. } = bag::select(bag, &wanted(params))?;
    let mut bytes = BTreeMap::<At, Vec<u8>>::new();
    for frame in &frames {
        bytes.insert(frame.at, Vec::new());
        frame.camera.map(|camera| bytes.insert(camera, Vec::new()));
    }
    let mut total = 0;
    for message in bag.messages() {
        let (at, message) = message?;
        let Some(kept) = bytes.get_mut(&at) else { continue };
        total += message.data.len();
        if total > MOST_BYTES {
            return Err("its messages take more than 1 GiB of memory: set `frames`".to_string());
        }
        *kept = message.data.into_owned();
    }
    let image_kind = if params.topic.contains("rect") { Image::Rectified } else { Image::Raw };
    let mut cameras = Cameras { image: image_kind, infos: Vec::new(), cameras: Vec::new() };
    let (mut times, mut read, mut scratch) = (Vec::new(), Vec::new(), Vec::new());
    for (place, frame) in frames.iter().enumerate() {
        // The number that `skip` counts.
        let by_time = params.skip as usize + place + 1;
        let fault = |e: String| format!("message {by_time} by time: {e}");
        let camera = match frame.camera {
            Some(at) => cameras
                .number(bytes.get(&at).map_or(&[], Vec::as_slice))
                .map_err(|e| fault(format!("its CameraInfo: {e}")))?,
            None => 0,
        };
        let message = bytes.remove(&frame.at).unwrap_or_default();
        times.push((message_time(&message).map_err(fault)?, frame.log_time));
        let points = match reading {
            Reading::Cloud => {
                let cloud = PointCloud2::parse(&message).map_err(|e| fault(e.to_string()))?;
                cloud.width() * cloud.height()
            }
            Reading::Image | Reading::Compressed => {
                let camera = &cameras.cameras[camera];
                scratch.resize(camera.rays.len(), [0.0; 3]);
                let image = image(reading, &message).map_err(fault)?;
                image
                    .points_into(camera.size, &camera.rays, &mut scratch)
                    .map_err(|e| fault(e.to_string()))?;
                scratch.len()
            }
        };
        if points > params.max_points as usize {
            return Err(fault(format!("it has {points} points: raise `max_points`")));
        }
        read.push((message, camera));
    }
    let playback = Playback::new(&origins(&times), params.pace, params.at_end);
    Ok(IngestMcap { reading, frames: read, cameras: cameras.cameras, playback })
}

/// Stamp of the header of a message, ns.
fn message_time(bytes: &[u8]) -> Result<u64, String> {
    Reader::in_either_order(bytes).and_then(|mut r| r.header()).map_err(|e| e.to_string())
}

/// The time of acquisition of each message, of its stamp and its log time, ns: the stamps, or the log times where a stamp
/// is missing or goes back.
fn origins(times: &[(u64, u64)]) -> Vec<u64> {
    let stamped = times.iter().all(|(stamp, _)| *stamp > 0) && times.is_sorted_by_key(|(stamp, _)| *stamp);
    times.iter().map(|(stamp, log_time)| if stamped { *stamp } else { *log_time }).collect()
}

/// The cameras of a recording, one for all equal infos.
struct Cameras {
    image: Image,
    infos: Vec<CameraInfo>,
    cameras: Vec<Camera>,
}

impl Cameras {
    /// The number of the camera that this `CameraInfo` describes.
    fn number(&mut self, bytes: &[u8]) -> Result<usize, String> {
        let info = CameraInfo::parse(bytes, self.image).map_err(|e| e.to_string())?;
        if let Some(number) = self.infos.iter().position(|known| *known == info) {
            return Ok(number);
        }
        if self.infos.len() == MOST_CAMERAS {
            return Err(format!(
                "it changes more than {MOST_CAMERAS} times: read a part with `skip` and `frames`"
            ));
        }
        let rays = info.rays().map_err(|e| e.to_string())?;
        self.cameras.push(Camera { size: [info.width, info.height], rays });
        self.infos.push(info);
        Ok(self.infos.len() - 1)
    }
}
