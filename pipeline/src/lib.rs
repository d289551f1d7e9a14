//! Pipelines of operators: from YAML to a checked graph, and from a graph to activations.
//!
//! An executor decides when the activations of operators happen: a schedule (clock, discrete events, journal) joined to
//! a placement (one process, threads, processes). The operators themselves are those of [`stillpoint_operator`].
//!
//! A pipeline:
//! - `config`: from YAML to a graph, with every fault of the file; `run_source`: what a graph was checked from
//! - `graph`: the checked pipeline; `hosts`: the part of it that runs on one host; `ros2`: what it exchanges with ROS 2
//! - `console`, `link`, `far_end`, `pool_client`, `null_sink`: the kinds of operators that come with every pipeline
//!
//! An activation:
//! - `instance`: one incarnation of an operator; `drafts`: its outputs before the commit; `intake`: its inputs;
//!   `settings`: its live parameters
//! - `record`: a schedule's decision; `schedule`: discrete events; `placement`: this thread, or a thread per operator
//! - `sample_store`: samples that are held in this process; `restarts`, `finished`: restart policy, end of a run
//!
//! A run:
//! - `live`: processes, supervisor, recorder; `simulated`: simulated and lock-step runs; `replay`: the journal's schedule
//! - `what_if`: a session with a changed pipeline
//! - `clock`: session time; `ledger`: the account of every edge; `stdout`: standard output while operators run
//! - `limits`: the limits of the system that a run may meet; `program`: the program of this process; `programs`: operators in programs of their own
//!
//! A session:
//! - `session`: topics, attachments and metadata; `session_recorder`: writes a run of this process
//! - `former_defaults`: defaults that have changed since a session was recorded
//! - `files`, `session_files`: the files that params name, of a run and of a session

// Outsiders use it.
#![warn(missing_docs)]

pub mod clock;
pub mod config;
pub mod console;
pub mod drafts;
mod far_end;
pub mod files;
mod finished;
pub mod former_defaults;
pub mod graph;
mod hosts;
pub mod instance;
mod intake;
pub mod ledger;
pub mod limits;
mod link;
pub mod live;
mod null_sink;
pub mod placement;
mod pool_client;
pub mod program;
pub mod programs;
pub mod record;
pub mod replay;
mod restarts;
mod ros2;
pub mod run_source;
pub mod sample_store;
pub mod schedule;
pub mod session;
pub mod session_files;
pub mod session_recorder;
pub mod settings;
pub mod simulated;
pub mod stdout;
pub mod what_if;

use stillpoint_operator as operator;
use stillpoint_operator::{Stage, activation, frames, outputs, outside, params};

/// The kinds of operators that come with every pipeline.
pub const STAGES: &[Stage] = &[console::STAGE, link::STAGE, pool_client::STAGE, null_sink::STAGE];
