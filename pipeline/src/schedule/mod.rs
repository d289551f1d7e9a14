//! Schedules: who says when an activation happens. They know nothing of where it happens.
//!
//! - `events`: discrete events, ordered by (time, place in the graph)
//!
//! The clock's schedule is spread over the processes of a live run and stands in `live`; the journal's stands in
//! `replay`.

mod events;

pub(crate) use events::depth_of;
pub use events::{Events, RunError, Witness};
