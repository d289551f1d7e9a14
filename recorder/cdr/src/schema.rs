//! The `ros2msg` texts of the messages of ROS 2 that are read or written, with all that they refer to.

/// Name of a type and its text.
pub type Schema = (&'static str, &'static str);

/// What every stamped message refers to.
macro_rules! header {
    () => {
        "\
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"
    };
}

/// A pose and what it refers to.
macro_rules! pose {
    () => {
        concat!(
            "\
================================================================================
MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
================================================================================
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
",
            quaternion!()
        )
    };
}

macro_rules! quaternion {
    () => {
        "\
================================================================================
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
"
    };
}

/// A cloud of points.
pub const POINT_CLOUD: Schema = (
    "sensor_msgs/msg/PointCloud2",
    concat!(
        "\
std_msgs/Header header
uint32 height
uint32 width
sensor_msgs/PointField[] fields
bool is_bigendian
uint32 point_step
uint32 row_step
uint8[] data
bool is_dense
",
        header!(),
        "\
================================================================================
MSG: sensor_msgs/PointField
uint8 INT8=1
uint8 UINT8=2
uint8 INT16=3
uint8 UINT16=4
uint8 INT32=5
uint8 UINT32=6
uint8 FLOAT32=7
uint8 FLOAT64=8
string name
uint32 offset
uint8 datatype
uint32 count
",
    ),
);

/// A pose with its covariance.
pub const POSE: Schema = (
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    concat!(
        "\
std_msgs/Header header
geometry_msgs/PoseWithCovariance pose
",
        header!(),
        "\
================================================================================
MSG: geometry_msgs/PoseWithCovariance
geometry_msgs/Pose pose
float64[36] covariance
",
        pose!(),
    ),
);

/// A pose.
pub const POSE_STAMPED: Schema = (
    "geometry_msgs/msg/PoseStamped",
    concat!(
        "\
std_msgs/Header header
geometry_msgs/Pose pose
",
        header!(),
        pose!(),
    ),
);

/// An image.
pub const IMAGE: Schema = (
    "sensor_msgs/msg/Image",
    concat!(
        "\
std_msgs/Header header
uint32 height
uint32 width
string encoding
uint8 is_bigendian
uint32 step
uint8[] data
",
        header!(),
    ),
);

/// An image in a compressed file.
pub const COMPRESSED_IMAGE: Schema = (
    "sensor_msgs/msg/CompressedImage",
    concat!(
        "\
std_msgs/Header header
string format
uint8[] data
",
        header!(),
    ),
);

/// A camera: matrix and distortion.
pub const CAMERA_INFO: Schema = (
    "sensor_msgs/msg/CameraInfo",
    concat!(
        "\
std_msgs/Header header
uint32 height
uint32 width
string distortion_model
float64[] d
float64[9] k
float64[9] r
float64[12] p
uint32 binning_x
uint32 binning_y
sensor_msgs/RegionOfInterest roi
",
        header!(),
        "\
================================================================================
MSG: sensor_msgs/RegionOfInterest
uint32 x_offset
uint32 y_offset
uint32 height
uint32 width
bool do_rectify
",
    ),
);

/// Places of frames.
pub const TRANSFORMS: Schema = (
    "tf2_msgs/msg/TFMessage",
    concat!(
        "\
geometry_msgs/TransformStamped[] transforms
================================================================================
MSG: geometry_msgs/TransformStamped
std_msgs/Header header
string child_frame_id
geometry_msgs/Transform transform
",
        header!(),
        "\
================================================================================
MSG: geometry_msgs/Transform
geometry_msgs/Vector3 translation
geometry_msgs/Quaternion rotation
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
",
        quaternion!(),
    ),
);

/// All of them.
pub const ALL: [Schema; 7] =
    [POINT_CLOUD, POSE, POSE_STAMPED, IMAGE, COMPRESSED_IMAGE, CAMERA_INFO, TRANSFORMS];
