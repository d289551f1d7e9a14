//! The channels of a topic: one for each of the values that a channel says once for all of its messages.

use std::collections::BTreeMap;
use std::io::Write;

use mcap::McapError;
use mcap::write::NoSeek;

use crate::form::{Form, Shared, schema};
use crate::topic::TopicInfo;

/// Channels that one topic may have; samples that would need more are recorded in their own form.
const MOST_CHANNELS: usize = 64;

/// A topic of a part, with the channels that it has so far.
pub(crate) struct Topic {
    pub info: TopicInfo,
    pub channels: BTreeMap<(Form, Shared), u16>,
    /// The last channel used: nearly always the next one too.
    pub last: Option<(Form, Shared, u16)>,
    pub camera_info: BTreeMap<Shared, u16>,
}

/// The file.
pub(crate) type Out<W> = mcap::Writer<NoSeek<W>>;

impl Topic {
    pub fn new(info: TopicInfo) -> Self {
        Self { info, channels: BTreeMap::new(), last: None, camera_info: BTreeMap::new() }
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
                metadata.insert("stillpoint.form".to_owned(), form.name().to_owned());
                metadata.insert("stillpoint.type".to_owned(), self.info.kind.type_name());
                if let Some(frame) = &self.info.frame {
                    metadata.insert("stillpoint.frame".to_owned(), frame.clone());
                }
                metadata.extend(key.1.entries(form));
                let channel = add_channel(out, &self.info.name, (&name, &text), &metadata)?;
                self.channels.insert(key.clone(), channel);
                channel
            }
        };
        self.last = Some((key.0, key.1, channel));
        Ok(channel)
    }

    /// The channel of the camera infos beside the images that share this.
    pub fn camera_info_channel<W: Write>(
        &mut self,
        out: &mut Out<W>,
        shared: Shared,
    ) -> Result<u16, McapError> {
        if let Some(channel) = self.camera_info.get(&shared) {
            return Ok(*channel);
        }
        let mut metadata = qos();
        metadata.insert("stillpoint.beside".to_owned(), self.info.name.clone());
        metadata.extend(shared.entries(Form::Depth));
        let name = format!("{}/camera_info", self.info.name);
        let channel = add_channel(out, &name, schema::CAMERA_INFO, &metadata)?;
        self.camera_info.insert(shared, channel);
        Ok(channel)
    }
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
