//! `stillpoint bench`: what the design promises, measured. Nothing here asserts a speed.
//!
//! - `hop`: from stage to stage, against bare iceoryx2
//! - `record`: what recording costs
//! - `killed`: what a session keeps of a recorder that was killed
//! - `ledger`: whether every sample is accounted for
//! - `replay`: whether sessions replay bit for bit, and how fast
//! - `step`: the dissertation's step, with many seeds
//! - `robust`, `cases`: the same while something is broken
//! - `tune`, `search`, `trials`: the laws after the same search
//! - `failsafe`, `casualty`, `evidence`: how long it takes to the safe state when something dies
//! - `closed_loop`: how long it takes from an image to the datagram that it has moved
//! - `program`: the default pipeline as a program of its own
//! - `stages`, `clouds`, `noise`, `poison`: the bench's own kinds of operators
//! - `window`: one pipeline, live for a while
//! - `bare`: chains of processes on bare iceoryx2 ports
//! - `processes`: the processes of a run, and chances to kill one
//! - `course`: one closed loop, simulated, and what of it is kept
//! - `laws`: the laws that take the place of the pipeline's
//! - `crew`: runs in several threads
//! - `cores`: which cores are used
//! - `figures`: quantiles and ratios
//! - `folder`: where sessions are written

pub mod bare;
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
mod killed;
mod laws;
mod ledger;
mod noise;
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

use clap::builder::RangedU64ValueParser;
use clap::{Args, Subcommand};
use stillpoint_pipeline::live::Launch;
use stillpoint_pipeline::operator::{Registry, Stage};

use crate::exit::{Ended, Failure};

/// Argument that makes this program a worker of a bench.
pub const WORKER: &str = "__bench_worker";
/// Argument that makes this program the recorder of a bench.
pub const RECORDER: &str = "__bench_recorder";
/// Argument that makes this program a run of a bench.
pub const RUN: &str = "__bench_run";

/// Measure how fast and how exact this build is on this machine.
#[derive(Args)]
pub struct Bench {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    Hop(hop::Hop),
    Record(record::Record),
    Killed(killed::Killed),
    Ledger(ledger::Ledger),
    Replay(replay::Replay),
    Failsafe(failsafe::Failsafe),
    Loop(closed_loop::ClosedLoop),
    Step(step::StepBench),
    Robust(robust::Robust),
    Tune(tune::Tune),
}

impl Bench {
    /// Does it.
    pub fn execute(&self, extra: &[&[Stage]]) -> Ended {
        let registry = registry(extra);
        match &self.what {
            What::Hop(b) => b.execute(&registry),
            What::Record(b) => b.execute(&registry),
            What::Killed(b) => b.execute(&registry),
            What::Ledger(b) => b.execute(&registry),
            What::Replay(b) => b.execute(&registry),
            What::Failsafe(b) => b.execute(&registry),
            What::Loop(b) => b.execute(&registry),
            What::Step(b) => b.execute(&registry),
            What::Robust(b) => b.execute(&registry),
            What::Tune(b) => b.execute(&registry),
        }
    }
}

/// The kinds that a bench knows: the command's, and its own.
pub fn registry(extra: &[&[Stage]]) -> Registry {
    let lists: Vec<&[Stage]> = extra
        .iter()
        .copied()
        .chain([stages::STAGES, clouds::STAGES, noise::STAGES, &[poison::STAGE]])
        .collect();
    crate::registry(&lists)
}

fn launch() -> Result<Launch, Failure> {
    let program = std::env::current_exe().map_err(Failure::failed)?;
    Ok(Launch { program, worker: WORKER, recorder: RECORDER })
}

/// A run of a bench, with the arguments of `run` behind [`RUN`]: it knows the bench's kinds.
#[derive(clap::Parser)]
struct BenchRun {
    #[command(flatten)]
    run: crate::run::Run,
}

/// The body of a run of a bench.
pub fn run_main(extra: &[&[Stage]]) -> Ended {
    let BenchRun { run } = clap::Parser::parse_from(std::env::args().skip(1));
    run.launched_by(launch()?).execute(&registry(extra))
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
