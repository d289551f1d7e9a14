//! Plans in a pipeline: a person has moved on the couch; does the plan still hold, and which plan is better?
//!
//! - [`optimizer`]: `plan.optimizer`, which answers requests
//! - [`watch`]: `plan.watch`, which makes requests from poses
//! - `params`: the parameters of `plan.optimizer`
//! - `job`: the work on one request, in parts; `remote`: what a planning pool computes of it
//! - `pooled`: the client of the pool in an operator
//! - `patient`: a case, ready for plans in any set-up
//! - [`protocol`]: the limits of protocol files

#![forbid(unsafe_code)]

mod job;
pub mod optimizer;
mod params;
mod patient;
mod pooled;
pub mod protocol;
mod remote;
pub mod watch;

use stillpoint_operator::Stage;

/// The operators of this family.
pub const STAGES: &[Stage] = &[Stage::of::<optimizer::PlanOptimizer>(), Stage::of::<watch::PlanWatch>()];
