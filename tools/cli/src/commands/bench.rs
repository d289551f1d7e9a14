//! `stillpoint bench`: starts `stillpoint-bench`, a separate program in the same folder.

use std::ffi::OsString;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::Command;

use clap::Args;

use stillpoint_pipeline::program::Program;

use crate::exit::{Ended, Failure};

/// Name of the program that measures.
const PROGRAM: &str = "stillpoint-bench";

/// Measure the speed and accuracy of this build on this machine, with the program `stillpoint-bench`.
#[derive(Args)]
#[command(disable_help_flag = true)]
pub struct Bench {
    /// The arguments of `stillpoint-bench`.
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "ARGUMENTS")]
    arguments: Vec<OsString>,
}

impl Bench {
    /// Replaces this process by the program that measures.
    pub fn execute(&self) -> Ended {
        let command = Program::here().map_err(Failure::failed)?.executable;
        let program = command.with_file_name(PROGRAM);
        if !program.is_file() {
            return Err(Failure::failed(format!(
                "{} does not exist: build it with `cargo build --release -p {PROGRAM}`, or install it with \
                 `cargo install --path tools/bench`",
                program.display()
            )));
        }
        if is_older(&program, &command) {
            errln!(
                "stillpoint: {PROGRAM} is older than this command: run `cargo build --release -p {PROGRAM}` to update it"
            );
        }
        let reason = Command::new(&program).args(&self.arguments).exec();
        Err(Failure::failed(format!("{}: {reason}", program.display())))
    }
}

/// Whether the file `a` was written before the file `b`, as far as the file system tells.
fn is_older(a: &Path, b: &Path) -> bool {
    let written = |path: &Path| path.metadata().and_then(|m| m.modified()).ok();
    matches!((written(a), written(b)), (Some(a), Some(b)) if a < b)
}
