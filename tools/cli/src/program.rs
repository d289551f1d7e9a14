//! How a program of this folder begins and ends, and how its runs start their children.

use std::process::ExitCode;

use clap::Parser;
use stillpoint_operator::Registry;
use stillpoint_pipeline::live::{Launch, recorder_main, worker_main};

use crate::exit::{Ended, Exit, Failure};
use crate::output;

/// First argument of a worker of a run.
const WORKER: &str = "__worker";
/// First argument of the recorder of a run.
const RECORDER: &str = "__recorder";

/// How a run starts its children: as this program, with a first argument that [`child`] knows.
///
/// # Errors
/// The path of this program cannot be had.
pub fn launch() -> Result<Launch, Failure> {
    let program = std::env::current_exe().map_err(Failure::failed)?;
    Ok(Launch { program, worker: WORKER, recorder: RECORDER })
}

/// Runs this process as a worker or a recorder, if its first argument says so. Gives the exit code then.
pub fn child(registry: &Registry) -> Option<ExitCode> {
    match std::env::args_os().nth(1)?.to_str()? {
        WORKER => Some(worker_main(registry)),
        RECORDER => Some(recorder_main(registry)),
        _ => None,
    }
}

/// Parses the arguments, executes them, and tells on standard error, after the program's `name`, why it failed.
pub fn program<A: Parser>(name: &str, execute: impl FnOnce(A) -> Ended) -> ExitCode {
    quiet_panics();
    let ended = match A::try_parse() {
        Ok(arguments) => execute(arguments),
        Err(answer) => {
            output::kept(answer.print());
            Ok(if answer.use_stderr() { Exit::Wrong } else { Exit::Done })
        }
    };
    let exit = ended.unwrap_or_else(|failure| {
        errln!("{name}: {}", failure.text);
        failure.exit
    });
    let Some(reason) = output::finish() else { return exit.into() };
    errln!("{name}: standard output cannot be written: {reason}");
    // The exit code of a command that failed says more than that its output was lost.
    if exit == Exit::Done { Exit::Failed.into() } else { exit.into() }
}

/// Replaces the message of panics. The panic of an operator is contained and journalled, and the run reports it: a
/// message here would only repeat that. Any other panic is a fault of stillpoint and is told as one.
fn quiet_panics() {
    std::panic::set_hook(Box::new(|panic| {
        if !stillpoint_pipeline::instance::is_stepping() {
            let text = panic.payload_as_str().unwrap_or_default();
            let place = panic.location().map(ToString::to_string).unwrap_or_default();
            errln!("stillpoint: a fault of stillpoint itself at {place}: {text}");
        }
    }));
}
