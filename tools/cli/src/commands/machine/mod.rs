//! `stillpoint machine`

mod fit;
mod page;

use clap::{Args, Subcommand};

use crate::exit::Ended;

/// Fit the machine file of a beam to doses measured in a water tank.
#[derive(Args)]
pub struct Machine {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Fit spectrum, penumbra, fluence and output calibration to depth doses, profiles and output factors.
    Fit(fit::Fit),
}

impl Machine {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        match &self.command {
            Command::Fit(c) => c.execute(),
        }
    }
}
