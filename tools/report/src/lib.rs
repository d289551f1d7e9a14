//! Analysis of sessions: the figures at the end of a run, and the report of a session as one self-contained page.
//!
//! A session is read once (`recording`). Each section computes figures from it and turns them into blocks ([`Section`]),
//! and the blocks become HTML ([`html::page`]). A new section is a file in `sections` and a line in its list.
//!
//! - `accuracy`, `hold`, `episodes`, `far_end`, `refused`, `unanswered`, `uncaptured`, `target_refusals`: the figures at the end of a run
//! - `facts`, `session_pipeline`, `wiring`: how a recording ended; the pipeline that a session keeps; edges of operators
//! - `recording`, `rows`, `thinned`: the data that is read; small samples over time; long series in bounded memory
//! - `compare`: two sessions, topic by topic and field by field
//! - `motion`, `offset`, `statistics`: estimates against the truth; plain numbers
//! - `contracts`: bounds of time against the journals
//! - `trace`: how long samples take from a source to a sink, and where the time goes
//! - `ramp`: the effect of a filter's gains on noise and on a ramp
//! - `proposal`: the picture of a captured face
//! - `views`, `camera`, `recomputed`, `overlay`: images with their detections; detections that a replay computes; both as pictures
//! - `sections`: one file for each section
//! - `page`, `html`, `escape`, `drawings`, `page.css`: sections and blocks; the page; its text, charts and style
//! - `isolines`: lines of one level
//! - `graph`: a pipeline as a picture, for the page and for `stillpoint graph`
//! - `chart`, `picture`, `numbers`: charts as SVG; PNG files; numbers as text

pub mod accuracy;
#[cfg(test)]
mod broken;
mod camera;
pub mod chart;
pub mod compare;
pub mod contracts;
mod drawings;
mod episodes;
mod error;
mod escape;
pub mod facts;
mod far_end;
pub mod graph;
pub mod hold;
pub mod html;
pub mod isolines;
mod judged;
mod motion;
pub mod numbers;
mod offset;
mod overlay;
pub mod page;
mod picture;
pub mod proposal;
mod ramp;
mod ranking;
mod recomputed;
mod recording;
pub mod refused;
mod rows;
mod sections;
mod session_pipeline;
mod source;
mod statistics;
pub mod target_refusals;
mod thinned;
pub mod trace;
pub mod unanswered;
pub mod uncaptured;
pub mod unproven;
mod views;
mod wiring;

use std::path::Path;
use std::sync::Arc;

use stillpoint_operator::Registry;
use stillpoint_recorder::Session;

pub use drawings::themed;
pub use error::ReportError;
pub use escape::escape;
pub use page::Section;
pub use picture::{Indexed, base64};
pub use session_pipeline::{MERGED, SessionPipeline, SessionPipelineError, pipeline_of, recorded_pipeline};

/// All sections of the report of the session at `path`, with at most this number of `pictures` per camera.
///
/// # Errors
/// Figures cannot be written as JSON, or a picture cannot be encoded.
pub fn sections_of(
    session: &Session,
    path: &Path,
    registry: &Registry,
    pictures: usize,
) -> Result<Vec<Section>, ReportError> {
    let pipeline = pipeline_of(session, registry).map(|(graph, files)| (Arc::new(graph), files));
    let source = source::Source { recording: recording::Recording::read(session, path), pipeline, pictures };
    sections::ALL.iter().map(|section| section(&source)).collect()
}
