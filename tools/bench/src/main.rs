//! `stillpoint-bench`, which `stillpoint bench` starts, measures the properties that the design promises. No
//! measurement asserts a speed.
//!
//! - `hop`: latency from operator to operator, against bare iceoryx2
//! - `record`: the cost of recording
//! - `killed`: the part of a session that survives the kill of its recorder
//! - `ledger`: the account of every sample
//! - `replay`: bit-for-bit replay, and its speed
//! - `step`: the dissertation's step, with many seeds
//! - `robust`, `cases`: the same step with disturbances and faults
//! - `hold`: a head that breathes, nods and coughs, held where it is
//! - `beside`: two laws side by side over these cases
//! - `optimum`: methods of choosing beams against the proved optimum
//! - `tune`, `search`, `trials`: comparison of the laws after the same search
//! - `failsafe`, `casualty`, `evidence`: the time to the safe state after a fault
//! - `identity`: captures of other objects than the head of drawn patients, and the time to beam off
//! - `acceptance`: figures of plans, beside those of a finer grid
//! - `closed_loop`: the latency from an image to the datagram that depends on it
//! - `program`: the default pipeline as a separate program
//! - `stages`, `clouds`, `noise`, `poison`: the bench's own kinds of operators
//! - `window`: one live run of a pipeline
//! - `bare`: chains of processes on bare iceoryx2 ports
//! - `processes`: the processes of a run, and random choices of one to kill
//! - `course`: one simulated closed loop and its figures
//! - `monitor`: the rules of beam and valves in a simulated run
//! - `observed`: the outputs of an activation, for observers of simulated runs
//! - `laws`: the laws that replace the law of the pipeline
//! - `crew`: runs in several threads
//! - `cores`: the cores that a measurement uses
//! - `figures`: quantiles and ratios
//! - `folder`: the folder of the sessions

// `outln!` and `errln!`.
#[macro_use]
extern crate stillpoint;

mod acceptance;
mod bare;
mod beside;
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
mod hold;
mod hop;
mod identity;
mod killed;
mod laws;
mod ledger;
mod monitor;
mod noise;
mod observed;
mod optimum;
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
    Hold(hold::Hold),
    Tune(tune::Tune),
    Plans(acceptance::Plans),
    Optimum(optimum::Optimum),
    /// `stillpoint run` with the bench's own kinds of operators, because a measurement runs pipelines in separate
    /// programs.
    #[command(name = RUN, hide = true)]
    Run(stillpoint::Run),
}

/// Name of the hidden subcommand that runs a pipeline.
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
            Self::Hold(b) => b.execute(registry),
            Self::Tune(b) => b.execute(registry),
            Self::Plans(b) => b.execute(),
            Self::Optimum(b) => b.execute(),
            Self::Run(run) => run.execute(registry),
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
    stillpoint::registry(&[
        stages::STAGES,
        clouds::STAGES,
        noise::STAGES,
        &[poison::STAGE],
        &[identity::camera::STAGE],
    ])
}

/// Parser of whole numbers from `least` on.
fn at_least<T: TryFrom<u64>>(least: u64) -> RangedU64ValueParser<T> {
    RangedU64ValueParser::new().range(least..)
}

/// Parses a finite number above 0.
fn positive(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|n| n.is_finite() && *n > 0.0);
    number.ok_or_else(|| "it must be a number above 0".to_string())
}
