//! The live executor: the clock's schedule, spread over processes.
//!
//! - `barrier`: the start barrier, live and in lock-step
//! - `children`: starting child processes, telling and hearing them
//! - `contracts`: the topics of a graph, and how much memory they take
//! - `control`: what supervisor and children say to each other
//! - `journal`: journal entries as samples in shared memory
//! - `error`: why a live run cannot begin or go on
//! - `missed`: what was sent while no recorder was there
//! - `ports`: the ports of one operator in shared memory
//! - `pipe`: lines over the children's pipes, unbuffered
//! - `report`: what a run is asked for, and how it went
//! - `room`: what runs take of shared memory, and leave to each other
//! - `run_folder`: where a run is found by others, and how a dead one is swept
//! - `wire`: the two ends of links
//! - `worker`: a process of operators
//! - `watch`: how long steps take, against their deadlines
//! - `directed`: a worker whose activations are decided by the supervisor
//! - `lockstep`: processes that do what a schedule tells them
//! - `runner`: one operator in a worker
//! - `recorder`: the process that records
//! - `affinity`: core and scheduling class of a process
//! - `status`: what a run looks like from its journals
//! - `stopwatch`: how long the stages of a step took
//! - `supervisor`: starts, watches, restarts and ends the processes of a run

mod affinity;
mod barrier;
mod children;
pub mod contracts;
pub mod control;
mod directed;
mod error;
mod journal;
mod lockstep;
mod missed;
mod pipe;
mod ports;
mod recorder;
mod report;
mod room;
pub mod run_folder;
mod runner;
pub mod status;
mod stopwatch;
mod supervisor;
mod watch;
mod wire;
mod worker;

pub use children::Launch;
pub use error::LiveError;
pub use journal::entry_of;
pub use lockstep::Processes;
pub use recorder::recorder_main;
pub use report::{Fault, Recorded, Run, RunOptions, RunReport};
pub use supervisor::Supervisor;
pub use worker::worker_main;
