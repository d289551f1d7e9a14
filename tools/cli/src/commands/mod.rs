//! The subcommands: one file or folder each, with its arguments and its `execute`.

mod bench;
mod case;
mod check;
mod echo;
mod identify;
mod info;
mod operators;
mod plan;
mod reach;
mod recover;
pub mod replay;
mod report;
mod rig;
pub mod run;
mod schema;
pub mod send;
#[cfg(feature = "train")]
mod train;
#[cfg(not(feature = "train"))]
#[path = "train_absent.rs"]
mod train;

use clap::Subcommand;
use stillpoint_operator::Registry;

use crate::exit::Ended;

/// A subcommand with its arguments.
#[derive(Subcommand)]
pub enum Command {
    /// Run a pipeline and record it.
    Run(run::Run),
    /// Run the far end of a pipeline as a program of its own.
    Rig(rig::Rig),
    /// Check a pipeline and show every fault of it.
    Check(check::Check),
    /// Run a session again from its journals, and compare every recorded topic byte by byte.
    Replay(replay::Replay),
    /// Show what a session holds, and whether it is complete.
    Info(info::Info),
    /// Make a page of a session: tracks, pictures, rates, latencies, the ledger, faults, what was run.
    Report(report::Report),
    /// Mend a session whose recorder was cut off.
    Recover(recover::Recover),
    /// Show the kinds of operators, or one of them.
    Operators(operators::Operators),
    /// Print the JSON Schema of pipelines.
    Schema(schema::Schema),
    /// Map which targets a rig can hold.
    Reach(reach::Reach),
    /// Send a person's command into a running pipeline.
    Send(send::Send),
    /// Fit a model to what went into a system and came out, from a session.
    Identify(identify::Identify),
    /// Train what is learned offline.
    Train(train::Train),
    /// Show the samples of a topic of a running pipeline or of a session.
    Echo(echo::Echo),
    /// Import, make and show patients to plan.
    Case(case::Case),
    /// Choose the beams of a case and their fluence.
    Plan(Box<plan::Plan>),
    /// Measure how fast and how exact this build is on this machine.
    Bench(bench::Bench),
}

impl Command {
    /// Executes the subcommand with these kinds of operators.
    pub fn execute(self, registry: &Registry) -> Ended {
        match self {
            Self::Run(c) => c.execute(registry),
            Self::Rig(c) => c.execute(registry),
            Self::Check(c) => c.execute(registry),
            Self::Replay(c) => c.execute(registry),
            Self::Info(c) => c.execute(registry),
            Self::Report(c) => c.execute(registry),
            Self::Recover(c) => c.execute(),
            Self::Operators(c) => c.execute(registry),
            Self::Schema(c) => c.execute(registry),
            Self::Reach(c) => c.execute(),
            Self::Send(c) => c.execute(registry),
            Self::Identify(c) => c.execute(),
            Self::Train(c) => c.execute(),
            Self::Echo(c) => c.execute(registry),
            Self::Case(c) => c.execute(),
            Self::Plan(c) => c.execute(),
            Self::Bench(c) => c.execute(),
        }
    }
}
