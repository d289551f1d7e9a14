//! `stillpoint-bridge foxglove`: the server of viewers. `stillpoint view --foxglove` starts it and hands over what is shown.

use std::process::ExitCode;

use clap::Args;

use super::exchange::ended;
use crate::viewers::serve;

/// Serve what comes on standard input to viewers such as Foxglove, on this machine alone.
#[derive(Args)]
pub struct Foxglove {}

impl Foxglove {
    /// Executes the subcommand.
    pub fn execute(&self) -> ExitCode {
        ended(serve(&mut std::io::stdin().lock(), Box::new(std::io::stdout())))
    }
}
