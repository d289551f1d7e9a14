//! The live executor: the clock's schedule, spread over processes.
//!
//! - `barrier`: the start barrier, live and in lock-step
//! - `bridge`: the process that carries samples between hosts
//! - `children`: child processes and their messages
//! - `contracts`: the topics of a graph, and how much memory they take
//! - `control`: the messages between supervisor and child processes
//! - `journal`: journal entries as samples in shared memory
//! - `error`: why a live run cannot begin or go on
//! - `landing`: where the bridge hands over the samples of another host
//! - `missed`: samples that were sent while no recorder ran
//! - `ports`: the ports of one operator in shared memory
//! - `pipe`: lines over the children's pipes, unbuffered
//! - `report`: the options of a run, and its report
//! - `reservation`: how much shared memory each run may take
//! - `run_folder`: the folder of a run, by which other programs find it, and the sweep of runs that died
//! - `wire`: the two ends of links
//! - `worker`: a process of operators
//! - `watch`: how long steps take, against their deadlines
//! - `directed`: a worker whose activations are decided by the supervisor
//! - `lockstep`: processes that a schedule directs
//! - `runner`: one operator in a worker
//! - `recorder`: the process that records
//! - `affinity`: core and scheduling class of a process
//! - `status`: counts, rates and latencies of a run, from its journals
//! - `stopwatch`: how long the stages of a step took
//! - `log`: what the processes of a run say
//! - `supervisor`: starts, watches, restarts and ends the processes of a run

mod affinity;
mod barrier;
pub mod bridge;
mod children;
pub mod contracts;
mod control;
mod directed;
mod error;
mod journal;
mod landing;
mod lockstep;
pub mod log;
mod missed;
mod pipe;
mod ports;
mod rate_limit;
mod recorder;
mod report;
mod reservation;
pub mod run_folder;
mod runner;
pub mod status;
mod stopwatch;
mod supervisor;
mod watch;
mod wire;
mod worker;

pub use affinity::granted;
pub use children::Launch;
pub use error::LiveError;
pub use journal::entry_of;
pub use lockstep::Processes;
pub use recorder::recorder_main;
pub use report::{Fault, Recorded, Run, RunOptions, RunReport};
pub use supervisor::{REFUSED, Supervisor};
pub use wire::{TransportOf, transport_of};
pub use worker::{end_worker, worker_main, worker_main_over};
