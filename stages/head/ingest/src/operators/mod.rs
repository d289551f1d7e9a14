//! The operators of this family, a file each.
//!
//! - `depth`: `ingest.depth`, depth images to clouds
//! - `pcd`: `ingest.pcd`, point cloud files to clouds
//! - `grey`: `ingest.grey`, image files to grey images
//! - `ply`: `ingest.ply`, the vertices of PLY files to clouds
//! - `mcap`: `ingest.mcap`, the clouds or depth images of an MCAP recording
//! - `ros2`: `ingest.ros2`, the clouds or depth images of a topic of ROS 2
//! - `driver`: `ingest.driver`, the depth images of a driver program
//! - `merge`: `ingest.merge`, the clouds of several cameras to one
//! - `recording`: the messages of a recording, played as clouds
//! - `messages`: clouds out of messages of ROS 2
//! - `files`: the files of a recording, named by a parameter
//! - `turn`: which of a recording's frames is next
//! - `playback`: when a message of a recording is sent
//! - `unit`: the unit of the coordinates of a file
//! - `points`: the points of a sample, in place

mod depth;
mod driver;
mod files;
mod grey;
mod mcap;
mod merge;
mod messages;
mod pcd;
mod playback;
mod ply;
mod points;
mod recording;
mod ros2;
mod turn;
mod unit;

pub use depth::{CameraParams, DepthParams, IngestDepth};
pub use driver::{DriverParams, IngestDriver};
pub use grey::{GreyParams, IngestGrey};
pub use mcap::{IngestMcap, McapParams};
pub use merge::{IngestMerge, MergeParams};
pub use messages::{Camera, Cameras, CamerasError, MessageError};
pub use pcd::{IngestPcd, PcdParams};
pub use playback::Pace;
pub use ply::{IngestPly, PlyParams};
pub use ros2::{IngestRos2, MessageType, Ros2Params, Stamps};
pub use turn::AtEnd;
pub use unit::Unit;
