//! `stillpoint train`: prints the command by which training is built and run. Training is a part of `stillpoint-research`,
//! a program of its own, so that the product builds without candle.

use clap::Args;

use crate::exit::{Ended, Failure};

/// Print the command that trains: training is a part of `stillpoint-research`, which is built from the source.
#[derive(Args)]
pub struct Train {
    /// The arguments of `stillpoint-research train`.
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "ARGUMENTS")]
    arguments: Vec<String>,
}

impl Train {
    /// Fails with the command that builds and starts the training.
    pub fn execute(&self) -> Ended {
        let mut command =
            "cargo run --release --manifest-path tools/research/Cargo.toml --target-dir target -- train"
                .to_owned();
        for argument in &self.arguments {
            command += " ";
            command += argument;
        }
        Err(Failure::failed(format!(
            "this program does not train: run `{command}` in the source folder of stillpoint"
        )))
    }
}
