//! The native part of the Python package `stillpoint_rt`.
//!
//! Classes and functions here take and give plain values, arrays of bytes and JSON; the Python sources next to it
//! (`stillpoint_rt/`) make the objects of which the documents speak.
//!
//! - `command`: the command `stillpoint` inside of an interpreter; `registry`: the kinds of operators
//! - `error`: failures as exceptions
//! - `operators`: operators in Python
//! - `planning`: cases, doses of beams, plans
//! - `run`: a run that goes on
//! - `session`: a recorded session; `samples`: the fields of sample types
//! - `interrupt`: long work that Ctrl-C ends

// But for one file: `operators/lend.rs`.
#![deny(unsafe_code)]

mod command;
mod error;
mod interrupt;
mod operators;
mod planning;
mod registry;
mod run;
mod samples;
mod session;

use pyo3::prelude::*;

/// The native part of `stillpoint_rt`.
#[pymodule]
mod _native {
    #[pymodule_export]
    use super::command::command;
    #[pymodule_export]
    use super::error::StillpointError;
    #[pymodule_export]
    use super::planning::{NativeBeams, NativeCase, NativeSetup};
    #[pymodule_export]
    use super::run::NativeRun;
    #[pymodule_export]
    use super::samples::sample_kinds;
    #[pymodule_export]
    use super::session::{NativeSession, diff};
}
