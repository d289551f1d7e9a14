//! The program that speaks with other hosts, `stillpoint-bridge`: a program of its own, since its network library takes
//! longer to build than all the rest.

use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::Command;

use clap::Args;

use crate::exit::{Ended, Failure};

const PROGRAM: &str = "stillpoint-bridge";

/// Arguments that the other program reads.
#[derive(Args)]
#[command(disable_help_flag = true)]
pub struct Bridge {
    /// Arguments of the same subcommand of `stillpoint-bridge`; `--help` lists them.
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "ARGUMENTS")]
    arguments: Vec<String>,
}

impl Bridge {
    /// Becomes the other program with this subcommand.
    pub fn execute(&self, subcommand: &str) -> Ended {
        let error = command()?.arg(subcommand).args(&self.arguments).exec();
        Err(Failure::failed(format!("{PROGRAM} cannot be started: {error}")))
    }
}

/// The program, which stands beside this one or is named in the environment.
///
/// # Errors
/// It is not there; the message says how it is built.
pub fn command() -> Result<Command, Failure> {
    let sibling = match std::env::var_os("STILLPOINT_BRIDGE") {
        Some(named) => PathBuf::from(named),
        None => std::env::current_exe().map_err(Failure::failed)?.with_file_name(PROGRAM),
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
