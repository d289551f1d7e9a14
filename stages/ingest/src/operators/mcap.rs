//! `ingest.mcap`: the clouds of a topic of an MCAP recording, one per tick.

use std::collections::{BTreeMap, BTreeSet};

use mcap::{Channel, McapError, Message, MessageStream};
use stillpoint_operator::{Activation, Operator, Outputs, Params, Setup};
use stillpoint_operator::{FrameRule, Kind, Output, Role, SetupError, StepError, Timer};
use stillpoint_samples::{PointCloud, Sample};

use super::points::send_cloud;
use super::turn::{AtEnd, Turn};
use crate::point_cloud2::PointCloud2;

const CLOUD: usize = 0;
/// Name of the schema that is read.
const SCHEMA: &str = "sensor_msgs/msg/PointCloud2";
/// Entry in the metadata of a channel of a session: the session's own name of the topic.
const OWN_NAME: &str = "stillpoint.topic";
/// Largest number of points of all clouds together: 1 GiB.
const MOST_POINTS: usize = (1 << 30) / size_of::<[f32; 3]>();

/// Parameters of `ingest.mcap`.
#[derive(Clone, Debug, Params)]
pub struct McapParams {
    /// An MCAP recording of ROS 2 messages.
    #[param(file)]
    pub file: String,
    /// Topic of `sensor_msgs/msg/PointCloud2` messages in it. Of a session, its own name (`cloud.cloud`) or that of ROS 2
    /// (`/cloud/cloud`).
    pub topic: String,
    /// Number of clouds to skip at the beginning, in the order of their log times.
    #[param(default = 0)]
    pub skip: u32,
    /// Largest number of clouds to read; without this parameter, all. They are held in memory.
    #[param(min = 1)]
    pub frames: Option<u32>,
    /// What follows the last cloud.
    #[param(default = "stop")]
    pub at_end: AtEnd,
    /// Largest number of points of a cloud: sets the size of shared memory.
    #[param(default = 307200, min = 1, max = 16777216)]
    pub max_points: u32,
}

/// Sends one cloud of the recording per tick, in the order of their log times.
pub struct IngestMcap {
    clouds: Vec<Cloud>,
    turn: Turn,
}

struct Cloud {
    width: usize,
    height: usize,
    points: Vec<[f32; 3]>,
}

impl Operator for IngestMcap {
    type Params = McapParams;
    const KIND: Kind = Kind {
        name: "ingest.mcap",
        about: "Reads the clouds (sensor_msgs/msg/PointCloud2) of an MCAP recording, one per tick.",
        role: Role::Operator,
        inputs: &[],
        outputs: &[Output {
            name: "cloud",
            sample: PointCloud::KIND,
            frame: FrameRule::Key,
            about: "The cloud of the message; organised if the message is.",
        }],
        timer: Timer::Required,
    };

    fn new(params: McapParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        let bytes = setup.file(&params.file)?;
        let clouds = read(&bytes, &params).map_err(|e| SetupError(format!("{}: {e}", params.file)))?;
        Ok(Self { turn: Turn::new(clouds.len(), params.at_end), clouds })
    }

    fn capacities(params: &McapParams) -> Vec<usize> {
        vec![params.max_points as usize]
    }

    fn step(&mut self, _: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let Some(frame) = self.turn.take() else {
            outputs.finish();
            return Ok(());
        };
        let cloud = &self.clouds[frame];
        send_cloud(outputs, CLOUD, cloud.width, cloud.height, |points| {
            points.copy_from_slice(&cloud.points);
            Ok(())
        })
    }
}

/// Reads the clouds that the parameters select. A recorder may write messages of one topic out of order, so their times
/// are read first.
fn read(bytes: &[u8], params: &McapParams) -> Result<Vec<Cloud>, String> {
    let times = log_times(bytes, params)?;
    let mut order: Vec<usize> = (0..times.len()).collect();
    order.sort_by_key(|&number| times[number]);
    let most = params.frames.map_or(usize::MAX, |frames| frames as usize);
    let places: BTreeMap<usize, usize> =
        order.into_iter().skip(params.skip as usize).take(most).zip(0..).collect();
    if places.is_empty() {
        return Err(format!("all {} clouds of {} are skipped: lower `skip`", times.len(), params.topic));
    }
    let (mut clouds, mut total) = (Vec::new(), 0);
    for (number, message) in messages(bytes)?.filter(|m| is_on(m, &params.topic)).enumerate() {
        let Some(place) = places.get(&number) else { continue };
        // The number that `skip` counts.
        let by_time = params.skip as usize + place + 1;
        let cloud = decode(&message?.data, params).map_err(|e| format!("cloud {by_time} by time: {e}"))?;
        total += cloud.points.len();
        if total > MOST_POINTS {
            return Err("its clouds take more than 1 GiB of memory: set `frames`".to_string());
        }
        clouds.push((place, cloud));
    }
    clouds.sort_by_key(|(place, _)| *place);
    Ok(clouds.into_iter().map(|(_, cloud)| cloud).collect())
}

/// Log times of the messages of the topic, in the order of the file; there is one at least.
fn log_times(bytes: &[u8], params: &McapParams) -> Result<Vec<u64>, String> {
    let (mut times, mut others) = (Vec::new(), BTreeSet::new());
    for message in messages(bytes)? {
        let message = message?;
        let (channel, encoding) = (&message.channel, &message.channel.message_encoding);
        let schema = channel.schema.as_ref().map_or("", |s| s.name.as_str());
        let is_cloud = schema == SCHEMA && encoding == "cdr";
        let is_named = is_named(channel, &params.topic);
        if is_named && !is_cloud {
            return Err(format!(
                "the topic {} has {schema} in {encoding}, not {SCHEMA} in cdr",
                params.topic
            ));
        }
        if is_named {
            times.push(message.log_time);
        } else if schema == SCHEMA {
            others.insert(channel.topic.clone());
        }
    }
    match (times.is_empty(), others.is_empty()) {
        (false, _) => Ok(times),
        (true, true) => Err(format!("it holds no {SCHEMA} at all")),
        (true, false) => {
            let others: Vec<_> = others.into_iter().collect();
            Err(format!("it has no clouds on {}, but on {}", params.topic, others.join(", ")))
        }
    }
}

/// The messages of a recording, in the order of the file.
fn messages(bytes: &[u8]) -> Result<impl Iterator<Item = Result<Message<'_>, String>>, String> {
    let unread = |e: McapError| match e {
        McapError::BadMagic => "it is no MCAP file".to_string(),
        McapError::UnexpectedEof => {
            "it ends in the middle of a record: repair a copy of it with `stillpoint recover`".to_string()
        }
        other => other.to_string(),
    };
    Ok(MessageStream::new(bytes).map_err(unread)?.map(move |message| message.map_err(unread)))
}

fn is_on(message: &Result<Message<'_>, String>, topic: &str) -> bool {
    message.as_ref().map_or(true, |m| is_named(&m.channel, topic))
}

fn is_named(channel: &Channel<'_>, topic: &str) -> bool {
    channel.topic == topic || channel.metadata.get(OWN_NAME).is_some_and(|name| name == topic)
}

fn decode(bytes: &[u8], params: &McapParams) -> Result<Cloud, String> {
    let message = PointCloud2::parse(bytes).map_err(|e| e.to_string())?;
    let (width, height) = (message.width(), message.height());
    let count = width * height;
    if count > params.max_points as usize {
        return Err(format!("it has {count} points: raise `max_points`"));
    }
    Ok(Cloud { width, height, points: message.points().collect() })
}
