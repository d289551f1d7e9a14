//! Converts the output of a sensor or a file into organised point clouds.
//!
//! A cloud here is row-major, in metres, in the camera's frame (x right, y down, z forward).
//! A pixel without a point holds [`INVALID_POINT`].
//!
//! - [`pcd`]: point cloud files, ascii, binary and compressed.
//! - [`depth`]: 16-bit depth images and their deprojection.
//! - [`grey`]: 8-bit grey images.
//! - [`ply`]: the vertices of PLY files.
//! - [`point_cloud2`], [`depth_message`], [`camera_info`]: clouds, depth images and cameras as ROS 2 records them.
//! - [`checks`]: what may be wrong with a cloud or an image, whoever reads it.
//! - [`rvl`]: a compression of depth images.
//! - [`bag`]: recordings of ROS 2, and which of their messages are read.
//! - [`driver_frame`]: depth images as a driver program sends them.
//! - [`merge`]: the clouds of several cameras as one.
//! - [`wire`]: messages of ROS 2 as they arrive: which are taken, and why the others are refused.
//! - [`operators`]: `ingest.depth`, `ingest.pcd`, `ingest.ply`, `ingest.grey`, `ingest.mcap`, `ingest.ros2`,
//!   `ingest.driver` and `ingest.merge`.

pub mod bag;
pub mod camera_info;
pub mod checks;
pub mod depth;
pub mod depth_message;
pub mod driver_frame;
pub mod grey;
pub mod merge;
pub mod operators;
pub mod pcd;
pub mod ply;
pub mod point_cloud2;
pub mod rvl;
pub mod wire;

use stillpoint_operator::Stage;

/// The one invalid point: a quiet NaN of one bit pattern in every coordinate, so that clouds compare by bytes.
pub const INVALID_POINT: [f32; 3] = [f32::from_bits(0x7fc0_0000); 3];

/// The operators of this family.
pub const STAGES: &[Stage] = &[
    Stage::of::<operators::IngestDepth>(),
    Stage::of::<operators::IngestPcd>(),
    Stage::of::<operators::IngestPly>(),
    Stage::of::<operators::IngestGrey>(),
    Stage::of::<operators::IngestMcap>(),
    Stage::of::<operators::IngestRos2>(),
    Stage::of::<operators::IngestDriver>(),
    Stage::of::<operators::IngestMerge>(),
];
