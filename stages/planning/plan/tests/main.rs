//! The planner's parts together, and on data.

#![allow(clippy::unwrap_used, clippy::panic)]

mod beams;
mod dose;
mod fluence;
mod leaves;
mod plans;
