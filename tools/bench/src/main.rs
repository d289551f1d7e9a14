//! `stillpoint-bench`, which `stillpoint bench` starts, measures what the design promises. No measurement asserts a speed.
//!
//! - `hop`: latency from operator to operator, against bare iceoryx2
//! - `record`: the cost of recording
//! - `killed`: the part of a session that survives the kill of its recorder
//! - `ledger`: the account of every sample
//! - `replay`: bit-for-bit replay, and its speed
//! - `step`: the dissertation's step, with many seeds
//! - `robust`, `cases`: the same step with disturbances and faults
//! - `tune`, `search`, `trials`: comparison of the laws after the same search
//! - `failsafe`, `casualty`, `evidence`: the time to the safe state after a fault
//! - `identity`: drawn patients: captures of what is not the head, and the time to beam off
//! - `closed_loop`: the latency from an image to the datagram that depends on it
//! - `program`: the default pipeline as a separate program
//! - `stages`, `clouds`, `noise`, `poison`: the bench's own kinds of operators
//! - `window`: one live run of a pipeline
//! - `bare`: chains of processes on bare iceoryx2 ports
//! - `processes`: the processes of a run, and random choices of one to kill
//! - `course`: one simulated closed loop and its figures
//! - `laws`: the laws that replace the law of the pipeline
//! - `crew`: runs in several threads
//! - `cores`: which cores are used
//! - `figures`: quantiles and ratios
//! - `folder`: where sessions are written

// `outln!` and `errln!`.
#[macro_use]
extern crate stillpoint;

mod bare;
mod cases;
mod casualty;
mod closed_loop;
mod clouds;
mod cores;
mod course;
mod crew;
mod evidence;
mod failsafe;
mod figures;
mod folder;
mod hop;
mod identity;
mod killed;
mod laws;
mod ledger;
mod noise;
mod observed;
mod poison;
mod processes;
mod program;
mod record;
mod replay;
mod robust;
mod search;
mod stages;
mod step;
mod trials;
mod tune;
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
    Identity(identity::Identity),
    Loop(closed_loop::ClosedLoop),
    Step(step::StepBench),
    Robust(robust::Robust),
    Tune(tune::Tune),
    /// `stillpoint run` with the bench's own kinds of operators, because a measurement runs pipelines in separate programs.
    #[command(name = RUN, hide = true)]
    Run(stillpoint::Run),
}

/// Subcommand that runs a pipeline.
const RUN: &str = "__run";

impl Measurement {
    fn execute(self, registry: &Registry) -> Ended {
        match self {
            Self::Hop(b) => b.execute(registry),
            Self::Record(b) => b.execute(registry),
            Self::Killed(b) => b.execute(registry),
            Self::Ledger(b) => b.execute(registry),
            Self::Replay(b) => b.execute(registry),
            Self::Failsafe(b) => b.execute(registry),
            Self::Identity(b) => b.execute(registry),
            Self::Loop(b) => b.execute(registry),
            Self::Step(b) => b.execute(registry),
            Self::Robust(b) => b.execute(registry),
            Self::Tune(b) => b.execute(registry),
            Self::Run(run) => run.execute(registry),
        }
    }
}

fn main() -> ExitCode {
    let registry = registry();
    if let Some(exit) = stillpoint::child(&registry) {
        return exit;
    }
    // What is not text is for clap to refuse.
    let [first, second] = [1, 2].map(|n| std::env::args_os().nth(n).and_then(|a| a.into_string().ok()));
    if first.as_deref() == Some(bare::CHILD) {
        return bare::child_main(second);
    }
    stillpoint::program("stillpoint-bench", |arguments: Arguments| arguments.measurement.execute(&registry))
}

/// The kinds of operators that a bench knows: the command's, and its own.
fn registry() -> Registry {
    stillpoint::registry(&[
        stages::STAGES,
        clouds::STAGES,
        noise::STAGES,
        &[poison::STAGE],
        &[identity::camera::STAGE],
    ])
}

/// Reads a whole number that is this at least.
fn at_least<T: TryFrom<u64>>(least: u64) -> RangedU64ValueParser<T> {
    RangedU64ValueParser::new().range(least..)
}

/// Reads a number above 0.
fn positive(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|n| n.is_finite() && *n > 0.0);
    number.ok_or_else(|| "it must be a number above 0".to_string())
}
