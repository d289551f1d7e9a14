//! The operator: a deterministic step machine, and all that its author sees.
//!
//! What enters an operator is an [`Activation`]; what leaves it are samples on its [`Outputs`]. An executor decides when
//! activations happen and where the bytes of samples stand: this crate knows neither shared memory nor recordings.
//!
//! - `operator`: the trait; `kind`: name, ports and timer of a kind; `stage`: the list of kinds that a build knows
//! - `wire_form`: what the datagrams of a kind look like
//! - `activation`, `outputs`: what enters a step and what leaves it
//! - `setup`: what an operator gets when it is made; `files`, `outside`: parts of it
//! - `params`: typed parameters and their derives
//! - `frames`: coordinate systems and rigid transforms
//! - `error`: why an operator cannot be made, and why a step failed
//! - `config`: the text of a config, from which parameters are read
//! - `pattern`: paths with a star
//! - `bench`: one operator in a test
//! - `program`: operators in a program of their own, which pipelines start
//! - `ros2`: messages of ROS 2 for a source

// Outsiders use it.
#![warn(missing_docs)]

// The derives name this crate by its path, here too.
extern crate self as stillpoint_operator;

pub mod activation;
pub mod bench;
pub mod config;
mod error;
mod feeder;
pub mod files;
pub mod frames;
mod kind;
mod listening;
mod operator;
pub mod outputs;
pub mod outside;
pub mod params;
pub mod pattern;
pub mod program;
pub mod ros2;
mod setup;
mod stage;
mod wire_form;

pub use activation::Activation;
pub use error::{AdoptError, DescribeError, ParamConflict, SetupError, StepError};
pub use feeder::{Feeder, FeederConflict};
pub use files::{Files, FilesError};
pub use kind::{FrameRule, Input, Kind, Output, Policy, Role, TIMING, Timer};
pub use listening::Listening;
pub use operator::{ErasedOperator, Operator};
pub use outputs::Outputs;
pub use params::{Choice, Params};
pub use setup::Setup;
pub use stage::{Build, Describe, Registry, SET, SETTINGS, Stage};
/// The samples that operators take and send.
pub use stillpoint_samples as samples;
pub use wire_form::WireForm;
