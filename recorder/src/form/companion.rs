//! Messages that stand beside those of a topic, for viewers alone: they hold nothing that the message itself lacks.

use stillpoint_cdr::Writer;
use stillpoint_samples::{Pieces, PoseElement};
use zerocopy::FromBytes;

use super::depth::intrinsics;
use super::{Form, schema};

/// A message beside another.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Companion {
    /// `sensor_msgs/msg/CameraInfo` of a depth image.
    CameraInfo,
    /// `geometry_msgs/msg/PoseStamped` of a pose.
    PoseStamped,
    /// The pose on `/tf`, as the place of a frame that has the name of its topic.
    Transform,
}

impl Companion {
    /// What stands beside samples in this form, whose coordinates are in `frame`.
    pub fn of(form: Form, frame: &str) -> &'static [Self] {
        match form {
            Form::Depth | Form::DepthMetres => &[Self::CameraInfo],
            Form::Pose if frame.is_empty() => &[Self::PoseStamped],
            Form::Pose => &[Self::PoseStamped, Self::Transform],
            Form::Own | Form::Cloud | Form::Grey => &[],
        }
    }

    /// Name of the channel beside a channel of this name.
    pub fn channel(self, companion: &str) -> String {
        match self {
            Self::CameraInfo => format!("{companion}/camera_info"),
            Self::PoseStamped => format!("{companion}/stamped"),
            Self::Transform => "/tf".to_owned(),
        }
    }

    /// Name and text of the schema.
    pub fn schema(self) -> schema::Schema {
        match self {
            Self::CameraInfo => schema::CAMERA_INFO,
            Self::PoseStamped => schema::POSE_STAMPED,
            Self::Transform => schema::TRANSFORMS,
        }
    }

    /// Appends the message beside a sample whose coordinates are in `frame`. `child` is the frame that a pose places.
    pub fn encode(self, sample: &Pieces<'_>, child: &str, frame: &str, out: &mut Vec<u8>) {
        let time = sample.header().origin;
        let pose = || PoseElement::read_from_bytes(sample.payload).ok();
        let mut w = Writer::new(out);
        match self {
            Self::CameraInfo => {
                w.header(time, frame);
                camera_info(sample, &mut w);
            }
            Self::PoseStamped => {
                w.header(time, frame);
                pose().iter().for_each(|pose| place(pose, &mut w));
            }
            Self::Transform => {
                w.u32(1);
                w.header(time, frame);
                w.text(child);
                pose().iter().for_each(|pose| place(pose, &mut w));
            }
        }
    }
}

/// Position and orientation: ROS puts the scalar of a quaternion last, a sample first.
fn place(pose: &PoseElement, w: &mut Writer<'_>) {
    let [qw, qx, qy, qz] = pose.orientation;
    w.f64s(&pose.position);
    w.f64s(&[qx, qy, qz, qw]);
}

fn camera_info(sample: &Pieces<'_>, w: &mut Writer<'_>) {
    let i = intrinsics(sample).unwrap_or_default();
    w.u32(i.height);
    w.u32(i.width);
    w.text("plumb_bob");
    w.u32(5);
    w.f64s(&[0.0; 5]);
    w.f64s(&[i.fx, 0.0, i.cx, 0.0, i.fy, i.cy, 0.0, 0.0, 1.0]);
    w.f64s(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    w.f64s(&[i.fx, 0.0, i.cx, 0.0, 0.0, i.fy, i.cy, 0.0, 0.0, 0.0, 1.0, 0.0]);
    w.u32(0);
    w.u32(0);
    // No region of interest: zeros mean the whole image.
    for _ in 0..4 {
        w.u32(0);
    }
    w.u8(0);
}
