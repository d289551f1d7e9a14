//! Pipelines of operators: from YAML to a checked graph, and from a graph to activations.
//!
//! An executor decides when the activations of operators happen: a schedule (clock, discrete events, journal) joined to
//! a placement (one process, threads, processes). The operators themselves are those of [`stillpoint_operator`].
//!
//! - `graph`: the checked pipeline
//! - `spec`: from YAML to a graph, with every fault of the file

pub mod clock;
pub mod console;
pub mod drafts;
pub mod far_end;
pub mod files;
pub mod finished;
pub mod graph;
pub mod hosts;
pub mod instance;
pub mod intake;
pub mod ledger;
pub mod link;
pub mod live;
pub mod placement;
pub mod record;
pub mod replay;
pub mod restarts;
pub mod run_source;
pub mod sample_store;
pub mod schedule;
pub mod session;
pub mod session_files;
pub mod session_recorder;
pub mod simulated;
pub mod spec;
pub mod stdout;

pub use stillpoint_operator as operator;
pub use stillpoint_operator::{
    Activation, Choice, Operator, Outputs, Params, Registry, Setup, Stage, activation, frames, outputs,
    outside, params, pattern,
};

/// The kinds of operators that come with every pipeline.
pub const STAGES: &[Stage] = &[console::STAGE, link::STAGE, far_end::DEPTH, far_end::GREY];
