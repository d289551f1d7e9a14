//! `stillpoint case`: patients in, one file each out, and looked at.
//!
//! - `import`: DICOM or NRRD with JSON, to a case file
//! - `phantom`: the project's own pelvis
//! - `show`: structures, volumes and pictures

mod import;
mod phantom;
mod show;

use clap::{Args, Subcommand};

use crate::exit::Ended;

/// Import, make and show patients to plan.
#[derive(Args)]
pub struct Case {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Make a case file of a DICOM folder (CT and RTSTRUCT), or of NRRD volumes with their JSON.
    Import(import::Import),
    /// Make the case file of a synthetic male pelvis from a seed.
    Phantom(phantom::Phantom),
    /// Show the structures of a case, and draw its central slices.
    Show(show::Show),
}

impl Case {
    /// Does it.
    pub fn execute(&self) -> Ended {
        match &self.command {
            Command::Import(c) => c.execute(),
            Command::Phantom(c) => c.execute(),
            Command::Show(c) => c.execute(),
        }
    }
}
