//! The `stillpoint` command: one file per subcommand.
//!
//! A program with operators of its own calls [`command`] with their lists, and has every subcommand:
//!
//! ```no_run
//! # const MY_STAGES: &[stillpoint_pipeline::Stage] = &[];
//! fn main() -> std::process::ExitCode {
//!     stillpoint::command(&[MY_STAGES])
//! }
//! ```
//!
//! Exit codes: 0 done; 1 failed, a recording was given up, the ledger does not balance, or standard output cannot be
//! written; 2 the command line or the pipeline is wrong; 3 a replay differs; 4 a session cannot be replayed as a whole,
//! but nothing differs; 5 a replay compared nothing.

// Before all others: its macros are for them.
#[macro_use]
mod output;

mod accuracy;
mod answer;
mod attach;
mod bench;
mod case;
mod chart;
mod check;
mod compress;
mod echo;
mod exit;
mod far_end;
mod hold;
mod identify;
mod info;
mod offset;
mod operators;
mod picture;
mod pipeline_file;
mod plan;
mod quantity;
mod reach;
mod recover;
mod refused;
mod replay;
mod report;
mod rig;
mod run;
mod schema;
mod send;
mod series;
mod show;
mod signals;
mod simulate;
mod status_line;
mod summary;
mod target_refusals;
#[cfg(feature = "train")]
mod train;
#[cfg(not(feature = "train"))]
#[path = "train_absent.rs"]
mod train;
mod uncaptured;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use stillpoint_pipeline::live::{recorder_main, worker_main};
use stillpoint_pipeline::operator::{Registry, Stage};

pub use exit::Exit;

/// Argument that makes this program a worker of a run.
const WORKER: &str = "__worker";
/// Argument that makes this program the recorder of a run.
const RECORDER: &str = "__recorder";

#[derive(Parser)]
#[command(name = "stillpoint", version, about = "Runs, records and replays pipelines of operators.")]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Subcommand)]
enum Command {
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

/// The kinds of operators that come with the command, and those of `extra`.
pub fn registry(extra: &[&[Stage]]) -> Registry {
    let mut lists: Vec<&[Stage]> = vec![
        stillpoint_pipeline::STAGES,
        stillpoint_ingest::STAGES,
        stillpoint_detect::STAGES,
        stillpoint_segment::STAGES,
        stillpoint_track::STAGES,
        stillpoint_estimate::STAGES,
        stillpoint_control::STAGES,
        stillpoint_actuate::STAGES,
        stillpoint_rig::STAGES,
        stillpoint_sink::STAGES,
    ];
    lists.extend(extra);
    Registry::new(&lists)
}

/// The body of the program. The children of a run are this program, too.
pub fn command(extra: &[&[Stage]]) -> ExitCode {
    let registry = registry(extra);
    // What is no text is clap's to refuse.
    let [first, second] = [1, 2].map(|n| std::env::args_os().nth(n).and_then(|a| a.into_string().ok()));
    match first.as_deref() {
        Some(WORKER) => return worker_main(&registry),
        Some(RECORDER) => return recorder_main(&registry),
        Some(bench::WORKER) => return worker_main(&bench::registry(extra)),
        Some(bench::RECORDER) => return recorder_main(&bench::registry(extra)),
        Some(bench::bare::CHILD) => return bench::bare::child_main(second),
        _ => {}
    }
    quiet_panics();
    if first.as_deref() == Some(bench::RUN) {
        return ended(bench::run_main(extra));
    }
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(answer) => {
            output::kept(answer.print());
            return ended(Ok(if answer.use_stderr() { Exit::Wrong } else { Exit::Done }));
        }
    };
    ended(match arguments.command.unwrap_or_else(|| Command::Run(run::Run::default())) {
        Command::Run(c) => c.execute(&registry),
        Command::Rig(c) => c.execute(&registry),
        Command::Check(c) => c.execute(&registry),
        Command::Replay(c) => c.execute(&registry),
        Command::Info(c) => c.execute(),
        Command::Report(c) => c.execute(&registry),
        Command::Recover(c) => c.execute(),
        Command::Operators(c) => c.execute(&registry),
        Command::Schema(c) => c.execute(&registry),
        Command::Reach(c) => c.execute(),
        Command::Send(c) => c.execute(&registry),
        Command::Identify(c) => c.execute(),
        Command::Train(c) => c.execute(),
        Command::Echo(c) => c.execute(&registry),
        Command::Case(c) => c.execute(),
        Command::Plan(c) => c.execute(),
        Command::Bench(c) => c.execute(extra),
    })
}

fn ended(done: exit::Ended) -> ExitCode {
    let exit = done.unwrap_or_else(|failure| {
        errln!("stillpoint: {}", failure.text);
        failure.exit
    });
    let Some(reason) = output::finish() else { return exit.into() };
    errln!("stillpoint: standard output cannot be written: {reason}");
    // What came out of the command says more than that it could not be told.
    if exit == Exit::Done { Exit::Failed.into() } else { exit.into() }
}

/// An operator's panic is contained, journalled and told: the default message would only stand beside that. Any other
/// panic is said as what it is.
fn quiet_panics() {
    std::panic::set_hook(Box::new(|panic| {
        if !stillpoint_pipeline::instance::is_stepping() {
            let text = panic.payload_as_str().unwrap_or_default();
            let place = panic.location().map(ToString::to_string).unwrap_or_default();
            errln!("stillpoint: a fault of stillpoint itself at {place}: {text}");
        }
    }));
}
