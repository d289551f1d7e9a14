//! The messages of ROS 2 as which a sample can be sent: those that recordings hold, for programs that record nothing.

use stillpoint_samples::{DepthImage, GreyImage, Pieces, PointCloud, Pose, Sample, SampleKind};

use super::{Companion, Form, StaticTransform, schema, transforms_message};

/// A message of ROS 2 that says a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum RosMessage {
    /// `sensor_msgs/msg/PointCloud2`.
    PointCloud2,
    /// `sensor_msgs/msg/Image`: `16UC1` in millimetres, `32FC1` in metres, or `mono8`.
    Image,
    /// `sensor_msgs/msg/CameraInfo` of a depth image.
    CameraInfo,
    /// `geometry_msgs/msg/PoseStamped`.
    PoseStamped,
    /// `geometry_msgs/msg/PoseWithCovarianceStamped`.
    PoseWithCovarianceStamped,
    /// `tf2_msgs/msg/TFMessage`: the pose as the place of a frame.
    TfMessage,
}

/// What is sent of each type of sample, the usual message first.
const OF_KINDS: [(&SampleKind, &[RosMessage]); 4] = [
    (PointCloud::KIND, &[RosMessage::PointCloud2]),
    (DepthImage::KIND, &[RosMessage::Image, RosMessage::CameraInfo]),
    (GreyImage::KIND, &[RosMessage::Image]),
    (Pose::KIND, &[RosMessage::PoseStamped, RosMessage::PoseWithCovarianceStamped, RosMessage::TfMessage]),
];

impl RosMessage {
    const ALL: [Self; 6] = [
        Self::PointCloud2,
        Self::Image,
        Self::CameraInfo,
        Self::PoseStamped,
        Self::PoseWithCovarianceStamped,
        Self::TfMessage,
    ];

    /// The messages as which samples of a kind can be sent, the usual one first.
    pub fn of(kind: &SampleKind) -> &'static [Self] {
        OF_KINDS.iter().find(|(of, _)| *of == kind).map_or(&[], |(_, messages)| messages)
    }

    /// Name and text of its type.
    pub fn schema(self) -> schema::Schema {
        match self {
            Self::PointCloud2 => schema::POINT_CLOUD,
            Self::Image => schema::IMAGE,
            Self::CameraInfo => schema::CAMERA_INFO,
            Self::PoseStamped => schema::POSE_STAMPED,
            Self::PoseWithCovarianceStamped => schema::POSE,
            Self::TfMessage => schema::TRANSFORMS,
        }
    }

    /// Name of its type.
    pub fn type_name(self) -> &'static str {
        self.schema().0
    }

    /// The message of this type name, with its package or without.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|m| m.type_name() == name || m.short_name() == name)
    }

    /// Name of its type without the package.
    pub fn short_name(self) -> &'static str {
        self.type_name().rsplit('/').next().unwrap_or_default()
    }

    /// Appends the message of a sample in `frame`. `child` is the frame that a pose places. Gives whether the message can
    /// say the sample: else nothing is appended.
    pub fn encode(
        self,
        kind: &SampleKind,
        sample: &Pieces<'_>,
        frame: &str,
        child: &str,
        out: &mut Vec<u8>,
    ) -> bool {
        let Some(form) = Form::of(kind).iter().find(|form| form.shared(sample).is_some()) else {
            return false;
        };
        match self {
            Self::PointCloud2 | Self::Image | Self::PoseWithCovarianceStamped => {
                form.encode(sample, frame, out);
            }
            Self::CameraInfo => Companion::CameraInfo.encode(sample, child, frame, out),
            Self::PoseStamped => Companion::PoseStamped.encode(sample, child, frame, out),
            Self::TfMessage => Companion::Transform.encode(sample, child, frame, out),
        }
        true
    }
}

/// The `tf2_msgs/msg/TFMessage` of frames that do not move, for `/tf_static`.
pub fn static_frames(transforms: &[StaticTransform]) -> Vec<u8> {
    transforms_message(0, transforms)
}
