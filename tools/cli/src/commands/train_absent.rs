//! `stillpoint train` in a build without training.

use clap::Args;

use crate::exit::{Ended, Failure};

/// Train what is learned offline. This build cannot: build with `--features train`.
#[derive(Args)]
pub struct Train {
    /// What was asked for.
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, hide = true)]
    rest: Vec<String>,
}

impl Train {
    /// Says how to build what can.
    pub fn execute(&self) -> Ended {
        Err(Failure::failed(format!(
            "this build cannot train: run `cargo run --release -p stillpoint --features train -- train {}`",
            self.rest.join(" ")
        )))
    }
}
