//! What a command is about: a running pipeline or a session.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::Value;
use stillpoint_operator::Registry;
use stillpoint_recorder::Session;

use crate::attach::{Attached, Which};
use crate::exit::Failure;
use crate::rates::{of_run, of_session};
use crate::recorded::with_topics;

/// The choice of a run or a session.
#[derive(Args, Clone, Debug, Default)]
pub struct Of {
    /// A running pipeline (the PID of its supervisor, or the name of the pipeline) or a session (its folder or file).
    /// Without it, the only run of this machine.
    #[arg(value_name = "RUN|SESSION")]
    of: Option<String>,
}

/// A running pipeline that was joined, or a session that was opened.
pub enum Subject {
    /// A run.
    Run(Box<Attached>),
    /// A session with its path.
    Session(PathBuf, Box<Session>),
}

impl Of {
    /// The run or session of this name.
    pub fn named(of: Option<String>) -> Self {
        Self { of }
    }

    /// The path, where what is meant is there as a file or folder.
    pub fn path(&self) -> Option<&Path> {
        self.of.as_ref().map(Path::new).filter(|path| path.exists())
    }

    /// The name that was given.
    pub fn name(&self) -> Option<String> {
        self.of.clone()
    }

    /// Joins the run, or opens the session.
    pub fn open(&self, registry: &Registry) -> Result<Subject, Failure> {
        if let Some(path) = self.path() {
            let session = with_topics(Session::open(path), path)?;
            return Ok(Subject::Session(path.to_owned(), Box::new(session)));
        }
        match &self.of {
            // A path that is not there is no name of a run.
            Some(name) if name.contains(std::path::MAIN_SEPARATOR) => {
                Err(Failure::failed(format!("{name}: there is no such session")))
            }
            _ => Ok(Subject::Run(Box::new(Which { run: self.of.clone() }.attach(registry)?))),
        }
    }
}

impl Subject {
    /// What it is, as commands name it in JSON.
    pub fn of(&self) -> Value {
        match self {
            Self::Run(attached) => of_run(attached),
            Self::Session(path, _) => of_session(path),
        }
    }
}
