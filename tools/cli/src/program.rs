//! The start and the end of a program, and the start of its child processes.

use std::ffi::OsString;
use std::process::ExitCode;

use clap::Parser;
use stillpoint_operator::Registry;
use stillpoint_pipeline::live::{Launch, recorder_main, worker_main};
use stillpoint_pipeline::program::Program;

use crate::exit::{Ended, Exit, Failure};
use crate::output;

/// First argument of a worker of a run.
const WORKER: &str = "__worker";
/// First argument of the recorder of a run.
const RECORDER: &str = "__recorder";

/// How a run starts its child processes: this program with a first argument that [`child`] knows.
///
/// # Errors
/// The path of this program is not known.
pub fn launch() -> Result<Launch, Failure> {
    let Program { executable, lead, environment, .. } = Program::here().map_err(Failure::failed)?;
    Ok(Launch { program: executable, lead, environment, worker: WORKER, recorder: RECORDER })
}

/// Runs this process as a worker or a recorder if its first argument says so, and gives the exit code.
pub fn child(registry: &Registry) -> Option<ExitCode> {
    match Program::arguments().first()?.to_str()? {
        WORKER => Some(worker_main(registry)),
        RECORDER => Some(recorder_main(registry)),
        _ => None,
    }
}

/// Parses and executes the arguments. Prints the reason of a failure on standard error after the `name` of the program.
pub fn program<A: Parser>(name: &str, execute: impl FnOnce(A) -> Ended) -> ExitCode {
    executed(name, execute).into()
}

/// The same with the exit code as it is named.
pub fn executed<A: Parser>(name: &str, execute: impl FnOnce(A) -> Ended) -> Exit {
    quiet_panics();
    let arguments = std::iter::once(OsString::from(name)).chain(Program::arguments());
    let ended = match A::try_parse_from(arguments) {
        Ok(arguments) => execute(arguments),
        Err(answer) => {
            output::checked(answer.print());
            Ok(if answer.use_stderr() { Exit::Wrong } else { Exit::Done })
        }
    };
    let exit = ended.unwrap_or_else(|failure| {
        errln!("{name}: {}", failure.text);
        failure.exit
    });
    let Some(reason) = output::finish() else { return exit };
    errln!("{name}: standard output cannot be written: {reason}");
    // The exit code of a command that failed says more than that its output was lost.
    if exit == Exit::Done { Exit::Failed } else { exit }
}

/// Replaces the message of panics. A panic of an operator is contained and journalled, and the run reports it, so no
/// message is printed here. Any other panic is reported as a fault of stillpoint.
fn quiet_panics() {
    std::panic::set_hook(Box::new(|panic| {
        if !stillpoint_pipeline::instance::is_stepping() {
            let text = panic.payload_as_str().unwrap_or_default();
            let place = panic.location().map(ToString::to_string).unwrap_or_default();
            errln!("stillpoint: internal fault of stillpoint at {place}: {text}");
        }
    }));
}
