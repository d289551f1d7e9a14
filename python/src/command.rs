//! The command inside of an interpreter.

use std::ffi::OsString;
use std::path::PathBuf;

use pyo3::prelude::*;
use stillpoint_pipeline::program::Program;

use crate::operators::lend_inputs;
use crate::registry::registry;

/// First argument of a worker of a run.
const WORKER: &str = "__worker";

/// Runs the command, or a child process of one of its runs, and gives the exit code. The interpreter's own reaction to
/// signals gives way to that of the command.
#[pyfunction]
pub fn command(
    py: Python<'_>,
    executable: PathBuf,
    lead: Vec<OsString>,
    environment: Vec<(String, String)>,
    code: PathBuf,
    arguments: Vec<OsString>,
    trusts: bool,
) -> u8 {
    if arguments.first().is_some_and(|first| first == WORKER) {
        lend_inputs();
    }
    Program { executable, lead, environment, code, arguments }.is_hosted();
    py.detach(|| stillpoint::hosted_command(&registry(trusts)))
}
