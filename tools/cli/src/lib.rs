//! The `stillpoint` command.
//!
//! A program with its own operators calls [`command`] with their lists and has every subcommand:
//!
//! ```no_run
//! # const MY_STAGES: &[stillpoint_operator::Stage] = &[];
//! fn main() -> std::process::ExitCode {
//!     stillpoint::command(&[MY_STAGES])
//! }
//! ```
//!
//! Each subcommand is a file or a folder of `commands/`. Code that several subcommands share stands beside that folder:
//!
//! - `program`: how a program begins and ends, and its children: shared with `stillpoint-bench`
//! - `exit`, `output`, `signals`: exit codes and failures, the two output streams, Ctrl-C
//! - `pipeline_file`, `compress`, `quantity`: arguments of several subcommands
//! - `rerun`: a session with a changed pipeline, computed and compared, for `replay` and for programs
//! - `simulate`, `status_line`, `summary`: parts of `run`
//! - `attach`, `tap`, `answer`, `proposal`: a running pipeline, its topics, its answers: parts of `echo` and `send`
//! - `number`, `path`, `screen`, `show`: values of samples in words and as JSON, for `echo`
//! - `subject`, `journals`: a run or a session, and the journals of a run, for the commands that look inside
//! - `delays`, `laps`: how long processes waited for a core, and the laps of steps, for `trace`
//! - `top`, `held`, `processes`: the state of a run or a session at one time, for `top`
//! - `view`: the page of a run or a session, for `view`
//! - `upstream`: the images behind a face, for `send` and `view`
//! - `metrics`: figures of a run as Prometheus text
//! - `doctor`: what is measured of the machine
//! - `rates`: rates of topics from journals, for `topics` and `hz`
//! - `series`, `picture`: parts of `identify`, `case` and `plan`
//! - `columns`: tables for a terminal
//! - `private`: files that only their owner may read
//! - `pool`: the options of `plan` for a pool of workers; `stillpoint-research train planner` uses them, too
//! - `jobs`: independent jobs in several threads, for programs that measure

// The first module: the others use its macros.
#[macro_use]
pub mod output;

mod amount;
mod answer;
mod attach;
mod columns;
mod commands;
mod compress;
mod delays;
mod determinism;
mod differences;
mod doctor;
mod exit;
mod held;
pub mod jobs;
mod journals;
mod laps;
mod metrics;
mod number;
mod out_folder;
mod path;
mod picture;
mod pipeline_file;
mod pool;
mod private;
mod processes;
mod program;
mod proposal;
mod quantity;
mod rates;
mod recorded;
mod rerun;
mod screen;
mod series;
mod settings;
mod show;
mod signals;
mod simulate;
mod status_line;
mod subject;
mod summary;
mod tap;
mod top;
mod upstream;
mod version;
mod view;

use std::process::ExitCode;

use clap::Parser;
use stillpoint_operator::{Registry, Stage};
use stillpoint_pipeline::program::Program;
use stillpoint_pipeline::programs;

pub use attach::{Attached, Which};
pub use commands::Command;
pub use commands::replay::opening_of;
pub use commands::run::Run;
pub use commands::send::deliver;
pub use exit::{Ended, Exit, Failure, print_json};
pub use pipeline_file::{EMBEDDED, EMBEDDED_FILES};
pub use pool::{PoolArgs, print_shares};
pub use program::{child, launch, program};
pub use quantity::quantity;
pub use rerun::{Computed, Nobody, Rerun, RerunError};
pub use tap::Tap;

/// Exit code of a child process that failed.
const CHILD_FAILED: u8 = 70;

/// In front of the subcommand: programs that sessions keep are started.
const TRUST: &str = "--trust";

#[derive(Parser)]
#[command(name = "stillpoint", version, about = "Runs, records and replays pipelines of operators.")]
struct Arguments {
    /// Start programs and sources of operators that a session keeps. They are code of whoever recorded it, and are not started
    /// unasked. Only before the subcommand: `stillpoint --trust replay SESSION`.
    #[arg(long)]
    trust: bool,
    #[command(subcommand)]
    command: Option<Command>,
}

/// The kinds of operators of the command, those of `extra`, and those of programs that pipelines name.
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
        stillpoint_planner::STAGES,
    ];
    lists.extend(extra);
    Registry::new(&lists).describing(programs::describe, programs::refuse_recorded)
}

/// The body of the program: runs the command, or a child process of one of its runs. `--trust` before the subcommand starts
/// programs that sessions keep.
pub fn command(extra: &[&[Stage]]) -> ExitCode {
    let mut here = Program::here().unwrap_or_default();
    if here.arguments.first().is_some_and(|first| first == TRUST) {
        here.arguments.remove(0);
        here.is_hosted();
        programs::trust_recorded();
    }
    ExitCode::from(hosted_command(&registry(extra)))
}

/// The same with these kinds of operators, for a program inside of another one. Gives the exit code.
pub fn hosted_command(registry: &Registry) -> u8 {
    stillpoint_pipeline::limits::fail_at_the_limit_of_file_sizes();
    if version::is_asked() {
        version::print();
        return 0;
    }
    match child(registry) {
        Some(ExitCode::SUCCESS) => 0,
        Some(_) => CHILD_FAILED,
        None => program::executed("stillpoint", |arguments: Arguments| {
            if arguments.trust {
                programs::trust_recorded();
            }
            arguments.command.unwrap_or_else(|| Command::Run(Run::default())).execute(registry)
        }) as u8,
    }
}
