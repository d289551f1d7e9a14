//! Which topics a recording has, and which of them can be read.

use std::collections::BTreeSet;
use std::sync::Arc;

use mcap::Channel;

use super::files::Bag;

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

    fn schema(self) -> &'static str {
        match self {
            Self::Cloud => "sensor_msgs/msg/PointCloud2",
            Self::Image => "sensor_msgs/msg/Image",
            Self::Compressed => "sensor_msgs/msg/CompressedImage",
        }
    }
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
pub fn check(bag: &Bag, topic: &str, camera_info: Option<&str>) -> Result<Named, String> {
    let topics = topics(bag)?;
    let with = |schema: &str| -> Vec<&str> {
        topics.iter().filter(|kind| kind.schema == schema).map(|kind| kind.topic.as_str()).collect()
    };
    let of_name = |topic: &str| {
        let found = topics.iter().find(|k| k.topic == topic || k.own_name.as_deref() == Some(topic));
        found.cloned()
    };
    let Some(kind) = of_name(topic) else {
        let others: Vec<&str> = Reading::ALL.iter().flat_map(|reading| with(reading.schema())).collect();
        let schemas = Reading::ALL.map(Reading::schema).join(", ");
        return Err(match others.is_empty() {
            true => format!("it has no messages on {topic}, and none of {schemas} at all"),
            false => format!("it has no messages on {topic}, but on {}", others.join(", ")),
        });
    };
    let readable =
        |k: &&Kind| k.encoding == "cdr" && Reading::ALL.iter().any(|reading| reading.schema() == k.schema);
    if let Some(other) =
        topics.iter().filter(|k| k.topic == kind.topic).find(|k| !readable(k) || k.schema != kind.schema)
    {
        let schemas = Reading::ALL.map(Reading::schema).join(", ");
        return Err(format!(
            "the topic {topic} has {} in {}, not one of {schemas} in cdr",
            other.schema, other.encoding
        ));
    }
    let reading = Reading::ALL.into_iter().find(|reading| reading.schema() == kind.schema);
    let Some(reading) = reading.filter(|reading| *reading != Reading::Cloud) else {
        return match camera_info {
            Some(_) => Err(format!("the topic {topic} has clouds, which need no `camera_info`: remove it")),
            None => Ok(Named { reading: Reading::Cloud, camera_info: None }),
        };
    };
    let asked = match camera_info {
        Some(name) => vec![name.to_owned()],
        None => sibling(&kind.topic),
    };
    let infos = with(CAMERA_INFO);
    match asked.iter().find(|name| infos.contains(&name.as_str())) {
        Some(name) => Ok(Named { reading, camera_info: Some(name.clone()) }),
        None => Err(match infos.is_empty() {
            true => format!(
                "it has images on {topic}, and no {CAMERA_INFO} on any topic, which their rays need: record it with them"
            ),
            false => format!(
                "it has no {CAMERA_INFO} on {}, but on {}: set `camera_info`",
                asked.join(" or "),
                infos.join(", ")
            ),
        }),
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
fn topics(bag: &Bag) -> Result<BTreeSet<Kind>, String> {
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
