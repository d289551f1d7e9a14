//! `stillpoint dose`

mod check;
mod page;

use clap::{Args, Subcommand};

use crate::exit::Ended;

/// Compare the dose of a machine with that of a Monte Carlo program.
#[derive(Args)]
pub struct Dose {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Compute the doses of a machine file on phantoms of water, lung, bone and air, and compare them with Monte Carlo.
    Check(check::Check),
}

impl Dose {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        match &self.command {
            Command::Check(c) => c.execute(),
        }
    }
}
