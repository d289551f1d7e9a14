//! The `ros2msg` texts of the messages of this project that are no samples. Those of ROS 2 stand in `stillpoint-cdr`.

pub(crate) use stillpoint_cdr::schema::{
    CAMERA_INFO, IMAGE, POINT_CLOUD, POSE, POSE_STAMPED, Schema, TRANSFORMS,
};

/// What could not be kept: `count` samples of `topic` from number `first` on.
pub(crate) const LOST: Schema = (
    "stillpoint_msgs/msg/Lost",
    "\
uint64 first
uint64 count
uint32 incarnation
string topic
",
);

/// Logical time against realtime, both ns since the epoch.
pub(crate) const CLOCK: Schema = (
    "stillpoint_msgs/msg/Clock",
    "\
uint64 logical  # ns
uint64 realtime  # ns
",
);
