//! `stillpoint-bench`, which `stillpoint bench` starts, measures the properties that the design promises. No
//! measurement asserts a speed. Campaigns that tune and judge are in `tools/research`.
//!
//! - `hop`: latency from operator to operator, against bare iceoryx2
//! - `record`: the cost of recording
//! - `killed`: the part of a session that survives the kill of its recorder
//! - `ledger`: the account of every sample
//! - `replay`: bit-for-bit replay, and its speed
//! - `failsafe`, `fault_trial`, `evidence`: the time to the safe state after a fault
//! - `closed_loop`: the latency from an image to the datagram that depends on it
//! - `tap`: the cost of an attached `echo`, `top` or `view`
//! - `scale`: start-up, memory and costs of pipelines with many operators
//! - `pool`: the time of recorded plans on other numbers of workers
//! - `program`: a pipeline as a separate program
//! - `attached`: a command that is attached to such a program
//! - `stages`, `clouds`, `nan_injection`: the bench's own kinds of operators
//! - `window`: one live run of a pipeline
//! - `bare`: chains of processes on bare iceoryx2 ports
//! - `processes`: the processes of a run, and random choices of one to kill
//! - `cores`: the cores that a measurement uses
//! - `figures`: quantiles and ratios
//! - `folder`: the folder of the sessions

// `outln!` and `errln!`.
#[macro_use]
extern crate stillpoint;

mod attached;
mod bare;
mod closed_loop;
mod clouds;
mod cores;
mod evidence;
mod failsafe;
mod fault_trial;
mod figures;
mod folder;
mod hop;
mod killed;
mod ledger;
mod nan_injection;
mod pool;
mod processes;
mod program;
mod record;
mod replay;
mod scale;
mod stages;
mod tap;
mod window;

use std::process::ExitCode;

use clap::builder::RangedU64ValueParser;
use clap::{Parser, Subcommand};
use stillpoint::Ended;
use stillpoint_operator::Registry;

/// Measure the speed and accuracy of this build on this machine.
#[derive(Parser)]
#[command(name = "stillpoint-bench", version)]
struct Arguments {
    #[command(subcommand)]
    measurement: Measurement,
}

#[derive(Subcommand)]
enum Measurement {
    Hop(hop::Hop),
    Record(record::Record),
    Killed(killed::Killed),
    Ledger(ledger::Ledger),
    Replay(replay::Replay),
    Failsafe(failsafe::Failsafe),
    Loop(closed_loop::ClosedLoop),
    Tap(tap::TapCost),
    Scale(scale::Scale),
    Pool(pool::Pool),
    /// `stillpoint` with the bench's own kinds of operators, because a measurement runs pipelines in separate programs,
    /// and attaches commands to them.
    #[command(name = COMMAND, hide = true)]
    Command {
        #[command(subcommand)]
        command: Box<stillpoint::Command>,
    },
}

/// Name of the hidden subcommand that is `stillpoint`.
const COMMAND: &str = "__stillpoint";

impl Measurement {
    fn execute(self, registry: &Registry) -> Ended {
        match self {
            Self::Hop(b) => b.execute(registry),
            Self::Record(b) => b.execute(registry),
            Self::Killed(b) => b.execute(registry),
            Self::Ledger(b) => b.execute(registry),
            Self::Replay(b) => b.execute(registry),
            Self::Failsafe(b) => b.execute(registry),
            Self::Loop(b) => b.execute(registry),
            Self::Tap(b) => b.execute(registry),
            Self::Scale(b) => b.execute(registry),
            Self::Pool(b) => b.execute(),
            Self::Command { command } => command.execute(registry),
        }
    }
}

fn main() -> ExitCode {
    let registry = registry();
    if let Some(exit) = stillpoint::child(&registry) {
        return exit;
    }
    // clap refuses an argument that is not text.
    let [first, second] = [1, 2].map(|n| std::env::args_os().nth(n).and_then(|a| a.into_string().ok()));
    if first.as_deref() == Some(bare::CHILD) {
        return bare::child_main(second);
    }
    stillpoint::program("stillpoint-bench", |arguments: Arguments| arguments.measurement.execute(&registry))
}

/// Kinds of operators of this program: those of `stillpoint`, and its own.
fn registry() -> Registry {
    stillpoint::registry(&[stages::STAGES, clouds::STAGES, &[nan_injection::STAGE]])
}

/// Parser of whole numbers from `least` on.
fn at_least<T: TryFrom<u64>>(least: u64) -> RangedU64ValueParser<T> {
    RangedU64ValueParser::new().range(least..)
}
