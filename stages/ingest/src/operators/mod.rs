//! The operators of this family, a file each.
//!
//! - `depth`: `ingest.depth`, depth images to clouds
//! - `pcd`: `ingest.pcd`, point cloud files to clouds
//! - `grey`: `ingest.grey`, image files to grey images
//! - `mcap`: `ingest.mcap`, the clouds of an MCAP recording
//! - `files`: the files of a recording, named by a parameter
//! - `turn`: which of a recording's frames is next
//! - `points`: the points of a sample, in place

mod depth;
mod files;
mod grey;
mod mcap;
mod pcd;
mod points;
mod turn;

pub use depth::{CameraParams, DepthParams, IngestDepth};
pub use grey::{GreyParams, IngestGrey};
pub use mcap::{IngestMcap, McapParams};
pub use pcd::{IngestPcd, PcdParams};
