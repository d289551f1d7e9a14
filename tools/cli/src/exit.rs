//! How the command ends.

use std::process::ExitCode;

use stillpoint_report::SessionPipelineError;

/// How the command ends; the number is its exit code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Exit {
    /// Done.
    Done = 0,
    /// Failed, the session of the run is not complete, or the ledger does not balance.
    Failed = 1,
    /// The command line or the pipeline is wrong.
    Wrong = 2,
    /// A replay differs from its recording, or two sessions differ.
    Differs = 3,
    /// A session cannot be replayed as a whole; the parts that can be replayed match.
    Open = 4,
    /// A replay compared nothing: no activation of the selected operators can be replayed.
    Nothing = 5,
    /// The plan check refuses the plan.
    Refused = 6,
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit as u8)
    }
}

/// Why a command failed, for people, and its exit code.
#[derive(Debug)]
pub struct Failure {
    /// What is wrong, where, why, and what to do. The name of the command is printed in front of it.
    pub text: String,
    /// How the command ends.
    pub exit: Exit,
}

impl Failure {
    /// The command failed.
    pub fn failed(text: impl std::fmt::Display) -> Self {
        Self { text: text.to_string(), exit: Exit::Failed }
    }

    /// The input of the user is wrong.
    pub fn wrong(text: impl std::fmt::Display) -> Self {
        Self { text: text.to_string(), exit: Exit::Wrong }
    }
}

impl From<SessionPipelineError> for Failure {
    fn from(error: SessionPipelineError) -> Self {
        match error {
            SessionPipelineError::Faults(_) => Self::wrong(error),
            _ => Self::failed(error),
        }
    }
}

/// How a subcommand ended.
pub type Ended = Result<Exit, Failure>;

/// Prints a value as JSON.
pub fn print_json(value: &impl serde::Serialize) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(value).map_err(Failure::failed)?;
    outln!("{text}");
    Ok(())
}
