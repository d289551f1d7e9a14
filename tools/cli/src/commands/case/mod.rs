//! `stillpoint case`: imports, generates and shows patients, one file for each.
//!
//! - `import`: DICOM or NRRD with JSON, to a case file
//! - `phantom`: the project's own pelvis and head
//! - `show`: structures, volumes and pictures
//! - `surface`: the outline as a mesh

mod import;
mod phantom;
mod show;
mod surface;

use clap::{Args, Subcommand};

use crate::exit::Ended;

/// Import, generate and show the patients of plans.
#[derive(Args)]
pub struct Case {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Make a case file from a DICOM folder (CT and RTSTRUCT), or from NRRD volumes with their JSON.
    Import(import::Import),
    /// Generate the case file of a synthetic patient from a seed: a male pelvis, the head that the rigs show, a head and
    /// neck, or a chest.
    Phantom(phantom::Phantom),
    /// Show the structures of a case and draw its central slices.
    Show(show::Show),
    /// Write the outline of a case as a mesh.
    Surface(surface::Surface),
}

impl Case {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        match &self.command {
            Command::Import(c) => c.execute(),
            Command::Phantom(c) => c.execute(),
            Command::Show(c) => c.execute(),
            Command::Surface(c) => c.execute(),
        }
    }
}
