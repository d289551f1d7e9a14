//! Heads on air bladders: rigs whose camera shows what the plant does, so that a loop closes through images.
//!
//! - `fault`: the faults, and their times
//! - `hardware`: what real valves, rubber and contacts do and ideal ones do not
//! - `safety`: what the valves do when duties stop
//! - `simulation`: plant, person, faults and valves through time
//! - `rigs`: a simulated rig from its entry in the table of rigs
//! - `params`: what a config may say
//! - [`mod@operator`]: `rig.one_bladder`, `rig.three_bladders`, `rig.eight_bladders`
//!
//! All modules but `params` and `operator` are plain mathematics that knows nothing of pipelines.

mod fault;
mod hardware;
pub mod operator;
mod params;
mod rigs;
mod safety;
mod simulation;
