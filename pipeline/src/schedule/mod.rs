//! Schedules: when activations happen. They know nothing of placements.
//!
//! - `decision`: which activation of an operator is due
//! - `events`: discrete events, ordered by (time, place in the graph)
//! - `waiting`: the samples on their way to one input
//!
//! The clock's schedule is spread over the processes of a live run and stands in `live`; the journal's stands in
//! `replay`.

mod decision;
mod events;
mod waiting;

pub(crate) use decision::{Decision, Ticks, decide};
pub use events::{Events, Observer, ObserverError, RunError};
pub(crate) use waiting::depth_of;
