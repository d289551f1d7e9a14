//! `track.head`: the pose of a head against a reference capture.
//!
//! - `params`: what the config may say
//! - `operator`: ports and steps
//! - `camera_sets`: which cameras the newest frames are of
//! - `pieces`: the pieces of the reference in each frame
//! - `report`: the report on each frame

mod camera_sets;
mod operator;
mod params;
mod pieces;
mod report;

pub use operator::TrackHead;
pub use params::{CaptureBy, HeadParams, Method, Origin, Reference, ReferenceParams, SendPieces, SoftTissue};
