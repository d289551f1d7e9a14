//! `ingest.mcap`: the clouds of a topic of an MCAP recording, one per tick.

use mcap::MessageStream;
use stillpoint_pipeline::operator::{FrameRule, Kind, Output, Role, SetupError, StepError, Timer};
use stillpoint_pipeline::{Activation, Operator, Outputs, Params, Setup};
use stillpoint_samples::{PointCloud, Sample};

use super::points::send_cloud;
use super::turn::{AtEnd, Turn};
use crate::point_cloud2::PointCloud2;

const CLOUD: usize = 0;
/// Name of the schema that is read.
const SCHEMA: &str = "sensor_msgs/msg/PointCloud2";
/// Points of all clouds together at most: 1 GiB.
const MOST_POINTS: usize = (1 << 30) / size_of::<[f32; 3]>();

/// Parameters of `ingest.mcap`.
#[derive(Clone, Debug, Params)]
pub struct McapParams {
    /// An MCAP recording of ROS 2 messages.
    #[param(file)]
    pub file: String,
    /// Topic of `sensor_msgs/msg/PointCloud2` messages in it.
    pub topic: String,
    /// Clouds passed over at the beginning.
    #[param(default = 0)]
    pub skip: u32,
    /// Clouds read at most; without it, all. They are held in memory.
    #[param(min = 1)]
    pub frames: Option<u32>,
    /// What comes after the last cloud.
    #[param(default = "stop")]
    pub at_end: AtEnd,
    /// Points of a cloud at most: shared memory is laid out by it.
    #[param(default = 307200, min = 1, max = 16777216)]
    pub max_points: u32,
}

/// Sends one cloud of the recording per tick, in the order of their log times.
pub struct IngestMcap {
    clouds: Vec<Cloud>,
    turn: Turn,
}

struct Cloud {
    log_time: u64,
    width: usize,
    height: usize,
    points: Vec<[f32; 3]>,
}

impl Operator for IngestMcap {
    type Params = McapParams;
    const KIND: Kind = Kind {
        name: "ingest.mcap",
        about: "Clouds (sensor_msgs/msg/PointCloud2) of an MCAP recording, one per tick.",
        role: Role::Operator,
        inputs: &[],
        outputs: &[Output {
            name: "cloud",
            sample: PointCloud::KIND,
            frame: FrameRule::Key,
            about: "The cloud as its message has it; organised where the message is.",
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

/// Reads the clouds that the parameters ask for.
fn read(bytes: &[u8], params: &McapParams) -> Result<Vec<Cloud>, String> {
    let messages = MessageStream::new(bytes).map_err(|e| e.to_string())?;
    let (mut clouds, mut number, mut total) = (Vec::new(), 0_u64, 0);
    let mut topics = std::collections::BTreeSet::new();
    for message in messages {
        let message = message.map_err(|e| e.to_string())?;
        let schema = message.channel.schema.as_ref().map_or("", |s| s.name.as_str());
        if schema == SCHEMA {
            topics.insert(message.channel.topic.clone());
        }
        if message.channel.topic != params.topic {
            continue;
        }
        if schema != SCHEMA || message.channel.message_encoding != "cdr" {
            let encoding = &message.channel.message_encoding;
            return Err(format!(
                "the topic {} has {schema} in {encoding}, not {SCHEMA} in cdr",
                params.topic
            ));
        }
        number += 1;
        if number <= u64::from(params.skip) {
            continue;
        }
        let cloud =
            decode(&message.data, message.log_time, params).map_err(|e| format!("cloud {number}: {e}"))?;
        total += cloud.points.len();
        if total > MOST_POINTS {
            return Err("its clouds take more than 1 GiB of memory: set `frames`".to_string());
        }
        clouds.push(cloud);
        if params.frames.is_some_and(|most| clouds.len() >= most as usize) {
            break;
        }
    }
    if clouds.is_empty() {
        return Err(match (number, topics.is_empty()) {
            (1.., _) => format!("all {number} clouds of {} are skipped: lower `skip`", params.topic),
            (0, true) => format!("it holds no {SCHEMA} at all"),
            (0, false) => {
                let topics: Vec<_> = topics.into_iter().collect();
                format!("it has no clouds on {}, but on {}", params.topic, topics.join(", "))
            }
        });
    }
    // A recorder may write messages of one topic out of order.
    clouds.sort_by_key(|c| c.log_time);
    Ok(clouds)
}

fn decode(bytes: &[u8], log_time: u64, params: &McapParams) -> Result<Cloud, String> {
    let message = PointCloud2::parse(bytes).map_err(|e| e.to_string())?;
    let (width, height) = (message.width(), message.height());
    let count = width * height;
    if count > params.max_points as usize {
        return Err(format!("it has {count} points: raise `max_points`"));
    }
    Ok(Cloud { log_time, width, height, points: message.points().collect() })
}
