//! `stillpoint recover`

use std::path::PathBuf;

use clap::Args;
use serde_json::json;
use stillpoint_recorder::{METADATA_FILE, Session, recover_session, write_metadata};

use crate::exit::{Ended, Exit, Failure, print_json};

/// Repair a session whose recorder was cut off.
#[derive(Args)]
pub struct Recover {
    /// The session: a folder of parts, or one file.
    session: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Recover {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        let mended = recover_session(&self.session).map_err(Failure::failed)?;
        // After the death of the supervisor, the parts may be whole, and nobody wrote what makes their folder a bag.
        let is_no_bag = self.session.is_dir() && !self.session.join(METADATA_FILE).exists();
        if !mended.is_empty() || is_no_bag {
            let session = Session::open_any(&self.session).map_err(Failure::failed)?;
            write_metadata(&self.session, &session).map_err(Failure::failed)?;
        }
        if self.json {
            let all: Vec<_> = mended
                .iter()
                .map(|(part, r)| {
                    json!({
                        "part": part.display().to_string(),
                        "messages": r.messages,
                        "attachments": r.attachments,
                        "metadata": r.metadata,
                        "entries_dropped": r.entries_dropped,
                        "outputs_dropped": r.outputs_dropped,
                        "damage": r.damage,
                        "bytes": r.bytes,
                        "bytes_cut": r.bytes_cut,
                        "kept": r.retained,
                    })
                })
                .collect();
            print_json(&all)?;
            return Ok(Exit::Done);
        }
        if mended.is_empty() && !is_no_bag {
            outln!("{}: nothing to mend", self.session.display());
        }
        if is_no_bag {
            outln!("{}: its {METADATA_FILE} was missing and has been written", self.session.display());
        }
        for (part, report) in mended {
            outln!("{}: {report}", part.display());
        }
        Ok(Exit::Done)
    }
}
