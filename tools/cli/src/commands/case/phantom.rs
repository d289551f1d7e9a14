//! `stillpoint case phantom`

use std::path::PathBuf;

use clap::Args;
use stillpoint_plan::case::{phantom, write};

use crate::exit::{Ended, Exit, Failure};

/// Make the case file of a synthetic male pelvis from a seed.
#[derive(Args)]
pub struct Phantom {
    /// The folder to write `pelvis-SEED.case` into.
    #[arg(long)]
    out: PathBuf,
    /// Which man; seed 0 is the one that plans use where no case is named.
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

impl Phantom {
    /// Does it.
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
