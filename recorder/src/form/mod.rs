//! How a sample stands in a recording, and how its exact bytes come back.
//!
//! Kinds that have a ROS message are recorded as that message. The others are recorded as their own bytes, which are a
//! CDR body already. A sample whose standard message would lose anything (a stamp beyond the range of ROS time, a grid
//! that is not its point count) is recorded in its own form on the same topic, so every form is lossless.
//!
//! What a standard message has no place for: its stamp is the origin, as ROS wants it, and the stamp of the sample is MCAP's
//! `publish_time`, which never goes back within a topic; the low half of the sequence is MCAP's `sequence`, and the high
//! half, the incarnation and what else holds for many samples at once are in the metadata of the channel, so that a topic
//! has a channel for each of their values. (Recordings of older builds have stamp and origin the other way round.)
//!
//! - `cdr`: numbers and texts at their CDR places
//! - `decoded`: a sample behind a message, not copied yet
//! - `own`: the sample's own bytes
//! - `cloud`: `PointCloud` as `sensor_msgs/msg/PointCloud2`
//! - `pose`: `Pose` as `geometry_msgs/msg/PoseWithCovarianceStamped`
//! - `depth`: `DepthImage` as `sensor_msgs/msg/Image` as REP 118 has it: whole millimetres, or metres
//! - `companion`: what viewers want beside a message: `CameraInfo`, `PoseStamped`, `/tf`
//! - `grey`: `GreyImage` as `sensor_msgs/msg/Image`
//! - `image`: the message of both
//! - `ros`: the messages as which a sample can be sent
//! - `transforms`: the static frames as `tf2_msgs/msg/TFMessage`
//! - `schema`: the `ros2msg` texts

mod cloud;
mod companion;
mod decoded;
mod depth;
mod grey;
mod image;
mod own;
mod pose;
mod ros;
pub(crate) mod schema;
mod transforms;

use std::collections::BTreeMap;

use stillpoint_cdr::CdrError;
use stillpoint_samples::{BytesError, Header, Pieces, SampleKind};

pub(crate) use companion::Companion;
pub(crate) use decoded::Decoded;
pub use ros::{RosMessage, static_frames};
pub use transforms::StaticTransform;
pub(crate) use transforms::{transforms_from, transforms_message};

/// Why a message is not the sample that it claims to be.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub(crate) enum Fault {
    #[error(transparent)]
    Cdr(#[from] CdrError),
    #[error(transparent)]
    Bytes(#[from] BytesError),
    #[error("a {kind} is not recorded as {form}")]
    Form { kind: &'static str, form: &'static str },
    #[error("its points have {0} fields where x, y and z are 3")]
    Fields(u32),
    #[error("{bytes} bytes are not {width} x {height} points of {size} bytes")]
    Points { bytes: usize, width: u32, height: u32, size: u32 },
    #[error("{bytes} bytes of `{}` are not {width} x {height} of `{expected}`", name.escape_debug())]
    Pixels { bytes: usize, name: String, width: u32, height: u32, expected: &'static str },
    #[error("{count} {items} are too many")]
    TooMany { count: u64, items: &'static str },
    #[error("a pixel of {metres} m is not a count of {unit} m")]
    Depth { metres: f32, unit: f64 },
    #[error("its channel does not say `{0}`")]
    Unstated(&'static str),
    #[error("`{name}` is `{}`, not a number", text.escape_debug())]
    Number { name: &'static str, text: String },
    #[error("the number of elements is too large")]
    TooLarge,
    #[error("{0} bytes follow its last element")]
    Rest(usize),
}

/// The message type that samples of a kind are recorded as.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Form {
    /// The sample's own bytes.
    #[default]
    Own,
    /// `sensor_msgs/msg/PointCloud2`.
    Cloud,
    /// `geometry_msgs/msg/PoseWithCovarianceStamped`.
    Pose,
    /// `sensor_msgs/msg/Image`, `16UC1`: counts, which are millimetres. (Recordings of older builds have any counts.)
    Depth,
    /// `sensor_msgs/msg/Image`, `32FC1`: metres, out of counts of any length.
    DepthMetres,
    /// `sensor_msgs/msg/Image`, `mono8`.
    Grey,
}

/// Which time stands where in a standard message.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Times {
    /// The message has the stamp, and MCAP's publish time is the origin: so older builds recorded.
    #[default]
    StampInside,
    /// The message has the origin, and MCAP's publish time is the stamp.
    OriginInside,
}

/// What one channel says about all of its messages.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Shared {
    pub incarnation: u32,
    pub times: Times,
    /// High half of the sequence.
    pub sequence_high: u32,
    /// What the form itself keeps here.
    pub extra: BTreeMap<String, String>,
}

/// Where a message stands beside its bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Envelope {
    /// MCAP's sequence.
    pub sequence: u32,
    /// MCAP's publish time.
    pub publish_time: u64,
}

impl Form {
    /// The standard forms of a kind, by its exact layout, the preferred one first.
    pub fn of(kind: &SampleKind) -> &'static [Self] {
        use stillpoint_samples::{DepthImage, GreyImage, PointCloud, Pose, Sample};
        const FORMS: [(&SampleKind, &[Form]); 4] = [
            (PointCloud::KIND, &[Form::Cloud]),
            (Pose::KIND, &[Form::Pose]),
            (DepthImage::KIND, &[Form::Depth, Form::DepthMetres]),
            (GreyImage::KIND, &[Form::Grey]),
        ];
        FORMS.iter().find(|(k, _)| *k == kind).map_or(&[], |(_, forms)| forms)
    }

    /// Name in a channel's metadata.
    pub fn name(self) -> &'static str {
        match self {
            Self::Own => "own",
            Self::Cloud => "PointCloud2",
            Self::Pose => "PoseWithCovarianceStamped",
            Self::Depth => "Image",
            Self::DepthMetres => "Image32FC1",
            Self::Grey => "GreyImage",
        }
    }

    /// The form of this name.
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::Own, Self::Cloud, Self::Pose, Self::Depth, Self::DepthMetres, Self::Grey]
            .into_iter()
            .find(|f| f.name() == name)
    }

    /// Name and text of the schema.
    pub fn schema(self, kind: &SampleKind) -> (String, String) {
        let (name, text) = match self {
            Self::Own => return (kind.schema_name(), kind.ros_schema()),
            Self::Cloud => schema::POINT_CLOUD,
            Self::Pose => schema::POSE,
            Self::Depth | Self::DepthMetres | Self::Grey => schema::IMAGE,
        };
        (name.to_owned(), text.to_owned())
    }

    /// The values that the channel of this sample must have. `None`: this form would lose a part of the sample.
    pub fn shared(self, sample: &Pieces<'_>) -> Option<Shared> {
        let header = sample.header();
        if self == Self::Own {
            // The bytes say everything themselves.
            return Some(Shared::default());
        }
        let extra = match self {
            Self::Own => BTreeMap::new(),
            _ if !stillpoint_cdr::is_ros_time(header.origin) => return None,
            Self::Cloud => cloud::fits(sample).then(BTreeMap::new)?,
            Self::Pose => BTreeMap::new(),
            Self::Depth => depth::millimetres(sample)?,
            Self::DepthMetres => depth::metres(sample)?,
            Self::Grey => grey::fits(sample).then(BTreeMap::new)?,
        };
        let (incarnation, times) = (header.incarnation, Times::OriginInside);
        Some(Shared { incarnation, times, sequence_high: (header.sequence >> 32) as u32, extra })
    }

    /// Appends the message to `out`.
    pub fn encode(self, sample: &Pieces<'_>, frame: &str, out: &mut Vec<u8>) {
        match self {
            Self::Own => own::encode(sample, out),
            Self::Cloud => cloud::encode(sample, frame, out),
            Self::Pose => pose::encode(sample, frame, out),
            Self::Depth => depth::encode(sample, frame, out),
            Self::DepthMetres => depth::encode_metres(sample, frame, out),
            Self::Grey => grey::encode(sample, frame, out),
        }
    }

    /// The sample behind a message.
    pub fn decode<'a>(
        self,
        kind: &SampleKind,
        shared: &Shared,
        envelope: Envelope,
        data: &'a [u8],
    ) -> Result<Decoded<'a>, Fault> {
        match self {
            Self::Own => own::decode(kind, data),
            Self::Cloud => cloud::decode(shared, envelope, data),
            Self::Pose => pose::decode(shared, envelope, data),
            Self::Depth => depth::decode(shared, envelope, data),
            Self::DepthMetres => depth::decode_metres(shared, envelope, data),
            Self::Grey => grey::decode(shared, envelope, data),
        }
    }
}

impl Shared {
    /// The header behind a message that has this time inside.
    fn header(&self, envelope: Envelope, inside: u64, count: u32) -> Header {
        let (stamp, origin) = match self.times {
            Times::StampInside => (inside, envelope.publish_time),
            Times::OriginInside => (envelope.publish_time, inside),
        };
        Header { stamp, origin, sequence: self.sequence(envelope), incarnation: self.incarnation, count }
    }

    /// The whole sequence number behind a message.
    pub fn sequence(&self, envelope: Envelope) -> u64 {
        u64::from(self.sequence_high) << 32 | u64::from(envelope.sequence)
    }
}

pub(crate) use own::header as own_header;

const INCARNATION: &str = "stillpoint.incarnation";
const SEQUENCE_HIGH: &str = "stillpoint.sequence_high";
const TIMES: &str = "stillpoint.times";
const ORIGIN_INSIDE: &str = "header.stamp is the origin, publish_time the stamp";

impl Shared {
    /// As entries of a channel's metadata. The own form needs none.
    pub fn entries(&self, form: Form) -> BTreeMap<String, String> {
        let mut entries = self.extra.clone();
        if form != Form::Own {
            entries.insert(INCARNATION.to_owned(), self.incarnation.to_string());
            entries.insert(SEQUENCE_HIGH.to_owned(), self.sequence_high.to_string());
            if self.times == Times::OriginInside {
                entries.insert(TIMES.to_owned(), ORIGIN_INSIDE.to_owned());
            }
        }
        entries
    }

    /// Out of a channel's metadata.
    pub fn from_entries(entries: &BTreeMap<String, String>) -> Self {
        let number = |key: &str| entries.get(key).and_then(|t| t.parse().ok()).unwrap_or(0);
        Self {
            incarnation: number(INCARNATION),
            times: match entries.contains_key(TIMES) {
                true => Times::OriginInside,
                false => Times::StampInside,
            },
            sequence_high: number(SEQUENCE_HIGH),
            extra: entries.clone(),
        }
    }
}
