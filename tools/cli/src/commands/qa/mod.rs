//! `stillpoint qa`
//!
//! - `daily`: a phantom moved by known steps and ramps, with a dated record
//! - `course`: the moves of the phantom
//! - `readings`: the session as traces of poses and of the beam
//! - `figures`: from traces to figures
//! - `record`: figures against limits, as table, JSON and page
//! - `commission`: what valves and bladders are, by a guided sequence

mod commission;
mod course;
mod daily;
mod figures;
mod readings;
mod record;

use clap::{Args, Subcommand};
use stillpoint_operator::Registry;

use crate::exit::Ended;

/// Check a system by a phantom of known motion, and find what its valves and bladders are.
#[derive(Args)]
pub struct Qa {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Move a phantom by known steps and ramps, and judge the poses and the time to beam off.
    Daily(daily::Daily),
    /// Find dead bands, volumes, supply and leaks of valves and bladders by a guided sequence.
    Commission(commission::Commission),
}

impl Qa {
    /// Executes the subcommand.
    pub fn execute(self, registry: &Registry) -> Ended {
        match self.command {
            Command::Daily(c) => c.execute(registry),
            Command::Commission(c) => c.execute(registry),
        }
    }
}
