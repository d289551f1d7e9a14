//! Heads on air bladders: rigs whose camera shows what the plant does, so that a loop closes through images.
//!
//! - [`fault`]: what can break, and when
//! - [`safety`]: what the valves do when duties stop
//! - [`simulation`]: plant, person, faults and valves through time
//! - [`rigs`]: the rigs by their number of bladders
//! - [`params`]: what a config may say
//! - [`mod@operator`]: `rig.one_bladder`, `rig.three_bladders`, `rig.eight_bladders`
//!
//! All but `params` and `operator` is plain mathematics that knows nothing of pipelines.

pub mod fault;
pub mod operator;
pub mod params;
pub mod rigs;
pub mod safety;
pub mod simulation;
