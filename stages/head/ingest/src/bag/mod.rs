//! Recordings of ROS 2: one MCAP file, or a folder of rosbag2 with `metadata.yaml`.
//!
//! - `files`: the MCAP files of a recording
//! - `topics`: which topics it has, and which of them can be read
//! - `select`: which messages are read
//! - `walk`: the messages of a file, with checksums and bounds
//! - `cut`: a recording with the messages that are read, and no others

mod cut;
mod files;
mod select;
mod topics;
mod walk;

pub use cut::{CutError, cut};
pub use files::{Bag, MetadataFault, OpenError};
pub use select::{At, Selected, Selection, select};
pub use topics::{Reading, TopicError, check};
pub use walk::{Message, WalkError};
