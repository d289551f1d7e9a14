//! The program that speaks with other hosts, `stillpoint-bridge`: a program of its own, since its network library takes
//! longer to build than all the rest.

use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::Command;

use stillpoint_pipeline::program::Program;

use crate::exit::{Ended, Failure};

const PROGRAM: &str = "stillpoint-bridge";

/// Becomes the other program with the arguments of this one, which were read for their faults and their help alone.
///
/// # Errors
/// The other program is not there, or cannot be started.
pub fn hand_over() -> Ended {
    let error = command()?.args(Program::arguments()).exec();
    Err(Failure::failed(format!("{PROGRAM} cannot be started: {error}")))
}

/// The program, which stands beside this one or is named in the environment.
///
/// # Errors
/// It is not there; the message says how it is built.
pub fn command() -> Result<Command, Failure> {
    let sibling = match std::env::var_os("STILLPOINT_BRIDGE") {
        Some(named) => PathBuf::from(named),
        None => Program::here().map_err(Failure::failed)?.executable.with_file_name(PROGRAM),
    };
    if sibling.is_file() {
        return Ok(Command::new(sibling));
    }
    Err(Failure::failed(format!(
        "{} is not there; build it with `cargo build --release --manifest-path tools/bridge/Cargo.toml \
         --target-dir target`, or name it in STILLPOINT_BRIDGE",
        sibling.display()
    )))
}
