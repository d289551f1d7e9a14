//! The channels of a topic: one for each of the values that a channel says once for all of its messages.

use std::collections::BTreeMap;
use std::io::Write;

use mcap::McapError;
use mcap::write::NoSeek;

use crate::encoded::Encoded;
use crate::form::{Companion, Form, Shared};
use crate::topic::TopicInfo;

/// Channels that one topic may have; samples that would need more are recorded in their own form.
const MOST_CHANNELS: usize = 64;

/// A topic of a part, with the channels that it has so far.
pub(crate) struct Topic {
    pub info: TopicInfo,
    pub channels: BTreeMap<(Form, Shared), u16>,
    /// The last channel used: nearly always the next one too.
    pub last: Option<(Form, Shared, u16)>,
    pub companion: BTreeMap<(Companion, Shared), u16>,
}

/// The file.
pub(crate) type Out<W> = mcap::Writer<NoSeek<W>>;

impl Topic {
    pub fn new(info: TopicInfo) -> Self {
        Self { info, channels: BTreeMap::new(), last: None, companion: BTreeMap::new() }
    }

    /// Whether the topic has a channel for samples in this form that share this, or may have one more.
    pub fn has_room(&self, form: Form, shared: &Shared) -> bool {
        form == Form::Own
            || self.last.as_ref().is_some_and(|(f, s, _)| *f == form && s == shared)
            || self.channels.len() < MOST_CHANNELS
            || self.channels.contains_key(&(form, shared.clone()))
    }

    /// The channel for samples in this form that share this, made where there is none yet.
    pub fn channel<W: Write>(
        &mut self,
        out: &mut Out<W>,
        form: Form,
        shared: Shared,
    ) -> Result<u16, McapError> {
        if let Some((f, s, channel)) = &self.last
            && *f == form
            && *s == shared
        {
            return Ok(*channel);
        }
        let key = (form, shared);
        let channel = match self.channels.get(&key) {
            Some(channel) => *channel,
            None => {
                let (name, text) = form.schema(self.info.kind);
                let mut metadata = qos();
                metadata.insert(TOPIC.to_owned(), self.info.name.clone());
                metadata.insert("stillpoint.form".to_owned(), form.name().to_owned());
                metadata.insert("stillpoint.type".to_owned(), self.info.kind.type_name());
                if let Some(frame) = &self.info.frame {
                    metadata.insert("stillpoint.frame".to_owned(), frame.clone());
                }
                metadata.extend(key.1.entries(form));
                let channel = add_channel(out, &ros_name(&self.info.name), (&name, &text), &metadata)?;
                self.channels.insert(key.clone(), channel);
                channel
            }
        };
        self.last = Some((key.0, key.1, channel));
        Ok(channel)
    }

    /// The channel of the messages beside samples such as this one.
    pub fn companion_channel<W: Write>(
        &mut self,
        out: &mut Out<W>,
        companion: Companion,
        sample: &Encoded,
    ) -> Result<u16, McapError> {
        let shared = &sample.shared;
        if let Some(channel) = self.companion.get(&(companion, shared.clone())) {
            return Ok(*channel);
        }
        let mut metadata = qos();
        metadata.insert(COMPANION.to_owned(), self.info.name.clone());
        metadata.extend(shared.entries(sample.form));
        let name = companion.channel(&ros_name(&self.info.name));
        let channel = add_channel(out, &name, companion.schema(), &metadata)?;
        self.companion.insert((companion, shared.clone()), channel);
        Ok(channel)
    }
}

/// Entry of a channel for viewers: the session's name of the topic whose samples its messages are made from, or nothing
/// where they are made from those of several.
pub(crate) const COMPANION: &str = "stillpoint.beside";

/// The channel of `/tf`.
pub(crate) fn add_transforms<W: Write>(out: &mut Out<W>) -> Result<u16, McapError> {
    let mut metadata = qos();
    metadata.insert(COMPANION.to_owned(), String::new());
    let name = Companion::Transform.channel("");
    add_channel(out, &name, Companion::Transform.schema(), &metadata)
}

/// Entry of a channel: the session's name of its topic.
pub(crate) const TOPIC: &str = "stillpoint.topic";

/// The name of a topic as ROS 2 accepts it: `head.pose` is `/head/pose`.
pub(crate) fn ros_name(topic: &str) -> String {
    let token = |token: &str| {
        let fits = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
        let name: String = token.chars().map(fits).collect();
        // No token begins with a digit.
        let digit = name.starts_with(|c: char| c.is_ascii_digit());
        if digit || name.is_empty() { format!("/_{name}") } else { format!("/{name}") }
    };
    topic.split('.').map(token).collect()
}

/// rosbag2 expects the key in every channel.
pub(crate) fn qos() -> BTreeMap<String, String> {
    BTreeMap::from([("offered_qos_profiles".to_owned(), String::new())])
}

/// The channel of this topic, schema and metadata.
pub(crate) fn add_channel<W: Write>(
    out: &mut Out<W>,
    topic: &str,
    (name, text): (&str, &str),
    metadata: &BTreeMap<String, String>,
) -> Result<u16, McapError> {
    let schema = out.add_schema(name, "ros2msg", text.as_bytes())?;
    out.add_channel(schema, topic, "cdr", metadata)
}
