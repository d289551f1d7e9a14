//! `stillpoint recover`

use std::path::PathBuf;

use clap::Args;
use stillpoint_recorder::recover_session;

use crate::exit::{Ended, Exit, Failure};

/// Mend a session whose recorder was cut off.
#[derive(Args)]
pub struct Recover {
    /// The session: a folder of parts, or one file.
    session: PathBuf,
}

impl Recover {
    /// Does it.
    pub fn execute(&self) -> Ended {
        let mended = recover_session(&self.session).map_err(Failure::failed)?;
        if mended.is_empty() {
            println!("{}: nothing to mend", self.session.display());
        }
        for (part, report) in mended {
            println!("{}: {report}", part.display());
        }
        Ok(Exit::Done)
    }
}
