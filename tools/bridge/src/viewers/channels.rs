//! What is shown as messages of Foxglove.

use std::sync::Arc;

use foxglove::messages::packed_element_field::NumericType;
use foxglove::messages::{
    FrameTransform, FrameTransforms, Log, PackedElementField, PointCloud, Pose, PoseInFrame, Quaternion,
    RawImage, Timestamp, Vector3, log::Level,
};
use foxglove::{Channel, Context, FoxgloveError, PartialMetadata, RawChannel, Schema};
use stillpoint_viewer::{Level as Grave, Place, Shown, Topic};

/// The channels, one for each topic.
pub struct Channels {
    image: Channel<RawImage>,
    face: Channel<PointCloud>,
    estimate: Channel<PoseInFrame>,
    target: Channel<PoseInFrame>,
    tf: Channel<FrameTransforms>,
    held: Arc<RawChannel>,
    state: Arc<RawChannel>,
    log: Channel<Log>,
}

fn stamp(time: u64) -> Timestamp {
    let seconds = u32::try_from(time / 1_000_000_000).unwrap_or(u32::MAX);
    Timestamp::new(seconds, (time % 1_000_000_000) as u32)
}

fn vector([x, y, z]: [f64; 3]) -> Vector3 {
    Vector3 { x, y, z }
}

fn quaternion([w, x, y, z]: [f64; 4]) -> Quaternion {
    Quaternion { x, y, z, w }
}

fn pose(place: &Place) -> Pose {
    Pose { position: Some(vector(place.position)), orientation: Some(quaternion(place.orientation)) }
}

impl Channels {
    /// Offers the channels.
    ///
    /// # Errors
    /// The library refuses one.
    pub fn open(context: &Arc<Context>) -> Result<Self, FoxgloveError> {
        let of = |topic: Topic| context.channel_builder(topic.name());
        let json = |topic: Topic| {
            let (name, schema) = topic.schema();
            of(topic)
                .message_encoding("json")
                .schema(Schema::new(name, "jsonschema", schema.to_string().into_bytes()))
                .build_raw()
        };
        Ok(Self {
            image: of(Topic::Image).build(),
            face: of(Topic::Face).build(),
            estimate: of(Topic::Estimate).build(),
            target: of(Topic::Target).build(),
            tf: of(Topic::Tf).build(),
            held: json(Topic::Held)?,
            state: json(Topic::State)?,
            log: of(Topic::Log).build(),
        })
    }

    /// Sends something to all who subscribe to it.
    pub fn show(&self, shown: Shown, bytes: Vec<u8>) {
        match shown {
            Shown::Image { time, frame, width, height } => {
                let message = RawImage {
                    timestamp: Some(stamp(time)),
                    frame_id: frame,
                    width,
                    height,
                    encoding: "rgb8".into(),
                    step: 3 * width,
                    data: bytes.into(),
                };
                self.image.log_with_time(&message, time);
            }
            Shown::Points { time, frame } => {
                let field = |(number, name): (u32, &str)| PackedElementField {
                    name: name.into(),
                    offset: 4 * number,
                    r#type: NumericType::Float32 as i32,
                };
                let message = PointCloud {
                    timestamp: Some(stamp(time)),
                    frame_id: frame,
                    pose: Some(pose(&Place { position: [0.0; 3], orientation: [1.0, 0.0, 0.0, 0.0] })),
                    point_stride: 12,
                    fields: (0..).zip(["x", "y", "z"]).map(field).collect(),
                    data: bytes.into(),
                };
                self.face.log_with_time(&message, time);
            }
            Shown::Pose { topic, time, frame, place } => {
                let message =
                    PoseInFrame { timestamp: Some(stamp(time)), frame_id: frame, pose: Some(pose(&place)) };
                let channel = if topic == Topic::Target { &self.target } else { &self.estimate };
                channel.log_with_time(&message, time);
            }
            Shown::Frame { time, parent, child, place } => {
                let transform = FrameTransform {
                    timestamp: Some(stamp(time)),
                    parent_frame_id: parent,
                    child_frame_id: child,
                    translation: Some(vector(place.position)),
                    rotation: Some(quaternion(place.orientation)),
                };
                self.tf.log_with_time(&FrameTransforms { transforms: vec![transform] }, time);
            }
            Shown::Values { topic, time, values } => {
                let channel = if topic == Topic::Held { &self.held } else { &self.state };
                channel.log_with_meta(values.to_string().as_bytes(), PartialMetadata::with_log_time(time));
            }
            Shown::Line { time, level, name, message } => {
                let level = match level {
                    Grave::Error => Level::Error,
                    Grave::Warn => Level::Warning,
                    Grave::Info => Level::Info,
                };
                let line = Log {
                    timestamp: Some(stamp(time)),
                    level: level as i32,
                    message,
                    name,
                    ..Log::default()
                };
                self.log.log_with_time(&line, time);
            }
            // They are for the server.
            Shown::Begin { .. } | Shown::Played => {}
        }
    }
}
