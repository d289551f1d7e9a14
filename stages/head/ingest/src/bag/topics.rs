//! Which topics a recording has, and which of them can be read.

use std::collections::BTreeSet;
use std::sync::Arc;

use mcap::Channel;

use super::files::Bag;
use super::walk::WalkError;

/// Entry in the metadata of a channel of a session: the session's own name of the topic.
const OWN_NAME: &str = "stillpoint.topic";
const CAMERA_INFO: &str = "sensor_msgs/msg/CameraInfo";

/// How the messages of a topic are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reading {
    /// `sensor_msgs/msg/PointCloud2`.
    Cloud,
    /// `sensor_msgs/msg/Image`.
    Image,
    /// `sensor_msgs/msg/CompressedImage`.
    Compressed,
}

impl Reading {
    const ALL: [Self; 3] = [Self::Cloud, Self::Image, Self::Compressed];

    /// The types of messages that are read.
    fn schemas() -> String {
        Self::ALL.map(Self::schema).join(", ")
    }

    fn schema(self) -> &'static str {
        match self {
            Self::Cloud => "sensor_msgs/msg/PointCloud2",
            Self::Image => "sensor_msgs/msg/Image",
            Self::Compressed => "sensor_msgs/msg/CompressedImage",
        }
    }
}

/// Why a topic of a recording is not read.
#[derive(Debug, thiserror::Error)]
pub enum TopicError {
    /// A file is not read.
    #[error(transparent)]
    Walk(#[from] WalkError),
    /// Nothing in it can be read.
    #[error("it has no messages on {topic}, and none of {} at all", Reading::schemas())]
    Nothing {
        /// The topic that was asked for.
        topic: String,
    },
    /// Other topics of it can be read.
    #[error("it has no messages on {topic}, but on {}", others.join(", "))]
    Missing {
        /// The topic that was asked for.
        topic: String,
        /// The topics that can be read.
        others: Vec<String>,
    },
    /// The topic has messages that are not read.
    #[error("the topic {topic} has {schema} in {encoding}, not one of {} in cdr", Reading::schemas())]
    Type {
        /// The topic.
        topic: String,
        /// Type of its messages.
        schema: String,
        /// How they are written.
        encoding: String,
    },
    /// Clouds have no camera.
    #[error("the topic {0} has clouds, which need no `camera_info`: remove it")]
    CameraOfClouds(String),
    /// There is no camera in it.
    #[error(
        "it has images on {0}, and no {CAMERA_INFO} on any topic, which their rays need: record it with them"
    )]
    NoCamera(String),
    /// Its cameras are on other topics.
    #[error("it has no {CAMERA_INFO} on {}, but on {}: set `camera_info`", asked.join(" or "), infos.join(", "))]
    OtherCamera {
        /// Where the camera is expected.
        asked: Vec<String>,
        /// Where cameras are.
        infos: Vec<String>,
    },
    /// No message of the topic is left to read.
    #[error("all {messages} messages of {topic} are skipped: lower `skip`")]
    Skipped {
        /// Messages of the topic.
        messages: usize,
        /// The topic.
        topic: String,
    },
}

/// What the channels of a topic have in common, and a session's own name of it.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Kind {
    topic: String,
    own_name: Option<String>,
    schema: String,
    encoding: String,
}

/// Names of the topics of what is read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Named {
    /// How its messages are read.
    pub reading: Reading,
    /// The topic of the camera's description; of a cloud none.
    pub camera_info: Option<String>,
}

/// Whether a channel is of the topic of this name, as ROS 2 or as the session names it.
pub fn is_named(channel: &Channel<'_>, topic: &str) -> bool {
    channel.topic == topic || channel.metadata.get(OWN_NAME).is_some_and(|name| name == topic)
}

/// Checks that the recording has messages of a known type on the topic, and a `CameraInfo` where they are images.
///
/// # Errors
/// What is missing or of another type, with what is there.
pub fn check(bag: &Bag, topic: &str, camera_info: Option<&str>) -> Result<Named, TopicError> {
    let topics = topics(bag)?;
    let with = |schema: &str| -> Vec<String> {
        topics.iter().filter(|kind| kind.schema == schema).map(|kind| kind.topic.clone()).collect()
    };
    let of_name = |topic: &str| {
        let found = topics.iter().find(|k| k.topic == topic || k.own_name.as_deref() == Some(topic));
        found.cloned()
    };
    let Some(kind) = of_name(topic) else {
        let others: Vec<String> = Reading::ALL.iter().flat_map(|reading| with(reading.schema())).collect();
        return Err(match others.is_empty() {
            true => TopicError::Nothing { topic: topic.to_owned() },
            false => TopicError::Missing { topic: topic.to_owned(), others },
        });
    };
    let readable =
        |k: &&Kind| k.encoding == "cdr" && Reading::ALL.iter().any(|reading| reading.schema() == k.schema);
    if let Some(other) =
        topics.iter().filter(|k| k.topic == kind.topic).find(|k| !readable(k) || k.schema != kind.schema)
    {
        let Kind { schema, encoding, .. } = other.clone();
        return Err(TopicError::Type { topic: topic.to_owned(), schema, encoding });
    }
    let reading = Reading::ALL.into_iter().find(|reading| reading.schema() == kind.schema);
    let Some(reading) = reading.filter(|reading| *reading != Reading::Cloud) else {
        return match camera_info {
            Some(_) => Err(TopicError::CameraOfClouds(topic.to_owned())),
            None => Ok(Named { reading: Reading::Cloud, camera_info: None }),
        };
    };
    let asked = match camera_info {
        Some(name) => vec![name.to_owned()],
        None => sibling(&kind.topic),
    };
    let infos = with(CAMERA_INFO);
    match asked.iter().find(|name| infos.contains(name)) {
        Some(name) => Ok(Named { reading, camera_info: Some(name.clone()) }),
        None if infos.is_empty() => Err(TopicError::NoCamera(topic.to_owned())),
        None => Err(TopicError::OtherCamera { asked, infos }),
    }
}

/// Where the `CameraInfo` of an image is looked for: beside it in its namespace, as image_transport has it, and below it,
/// as sessions have it.
fn sibling(topic: &str) -> Vec<String> {
    let of = |image: &str| {
        let namespace = image.rsplit_once('/').map_or("", |(namespace, _)| namespace);
        [format!("{namespace}/camera_info"), format!("{image}/camera_info")]
    };
    let mut all = of(topic).to_vec();
    // A transport stands behind the name of the image.
    if let Some((image, "compressedDepth" | "compressed")) = topic.rsplit_once('/') {
        all.extend(of(image));
    }
    all
}

/// The topics that have messages. Summaries are not believed: what a file has is what stands in it.
fn topics(bag: &Bag) -> Result<BTreeSet<Kind>, WalkError> {
    let mut topics = BTreeSet::new();
    // A channel is looked at once.
    let mut last = None;
    for message in bag.messages() {
        let (_, message) = message?;
        if last.as_ref().is_some_and(|channel| Arc::ptr_eq(channel, &message.channel)) {
            continue;
        }
        let channel = &message.channel;
        topics.insert(Kind {
            topic: channel.topic.clone(),
            own_name: channel.metadata.get(OWN_NAME).cloned(),
            schema: channel.schema.as_ref().map_or(String::new(), |s| s.name.clone()),
            encoding: channel.message_encoding.clone(),
        });
        last = Some(message.channel);
    }
    Ok(topics)
}
