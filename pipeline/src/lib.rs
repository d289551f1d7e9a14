//! Pipelines of operators: from YAML to a checked graph, and from a graph to activations.
//!
//! An operator is a deterministic step machine ([`Operator`]). An executor decides when its activations happen: a
//! schedule (clock, discrete events, journal) joined to a placement (one process, threads, processes).
//!
//! - `operator`, `activation`, `outputs`, `setup`, `frames`: what the author of an operator sees
//! - `params`: typed parameters
//! - `graph`: the checked pipeline
//! - `spec`: from YAML to a graph, with every fault of the file

// The derives name this crate by its path, here too.
extern crate self as stillpoint_pipeline;

pub mod activation;
pub mod clock;
pub mod console;
pub mod files;
pub mod finished;
pub mod frames;
pub mod graph;
pub mod hosts;
pub mod instance;
pub mod intake;
pub mod ledger;
pub mod link;
pub mod live;
pub mod operator;
pub mod outputs;
pub mod outside;
pub mod params;
pub mod pattern;
pub mod placement;
pub mod record;
pub mod replay;
pub mod restarts;
pub mod sample_store;
pub mod schedule;
pub mod session;
pub mod session_recorder;
pub mod setup;
pub mod spec;
pub mod stdout;
pub mod stream;

pub use activation::Activation;
pub use operator::{Operator, Registry, Stage};
pub use outputs::Outputs;
pub use params::{Choice, Params};
pub use setup::Setup;

/// The kinds of operators that come with every pipeline.
pub const STAGES: &[Stage] = &[console::STAGE, link::STAGE, stream::DEPTH, stream::GREY];
