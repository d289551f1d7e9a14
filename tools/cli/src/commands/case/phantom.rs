//! `stillpoint case phantom`

use std::path::PathBuf;

use clap::Args;
use stillpoint_plan::case::{phantom, write};

use crate::exit::{Ended, Exit, Failure};

/// Generate the case file of a synthetic male pelvis from a seed.
#[derive(Args)]
pub struct Phantom {
    /// The folder in which `pelvis-SEED.case` is written.
    #[arg(long)]
    out: PathBuf,
    /// Seed of the phantom. Plans without a case use seed 0.
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

impl Phantom {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        let case = phantom(self.seed).map_err(Failure::failed)?;
        let fault = |e| Failure::failed(format!("{}: {e}", self.out.display()));
        std::fs::create_dir_all(&self.out).map_err(fault)?;
        let path = self.out.join(format!("{}.case", case.name()));
        let hash = write(&case, &path).map_err(Failure::failed)?;
        outln!("{}: {}", path.display(), case.provenance());
        outln!("hash {hash}");
        Ok(Exit::Done)
    }
}
