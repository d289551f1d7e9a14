//! Schedules: when activations happen. They know nothing of placements.
//!
//! - `decision`: which activation of an operator is due
//! - `events`: discrete events, ordered by (time, place in the graph)
//! - `fed`: activations that happened already, among those that a schedule decides
//! - `latencies`: how long steps take
//! - `waiting`: the samples on their way to one input
//!
//! The clock's schedule is spread over the processes of a live run and stands in `live`; the journal's stands in
//! `replay`.

mod decision;
mod events;
mod fed;
mod latencies;
mod waiting;

pub(crate) use decision::{Decision, Ticks, decide};
pub use events::{Events, Observer, ObserverError, RunError};
pub use fed::{Fed, Feed};
pub use latencies::{Latencies, Measured};
pub(crate) use waiting::depth_of;
