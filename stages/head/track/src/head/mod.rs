//! `track.head`: the pose of a head against a reference capture.
//!
//! - `params`: what the config may say
//! - `operator`: ports and steps
//! - `pieces`: the pieces of the reference in each frame
//! - `report`: the report on each frame

mod operator;
mod params;
mod pieces;
mod report;

pub use operator::TrackHead;
pub use params::{CaptureBy, HeadParams, Method, Origin, Reference, ReferenceParams, SendPieces, SoftTissue};
