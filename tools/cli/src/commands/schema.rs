//! `stillpoint schema`

use clap::Args;
use stillpoint_operator::Registry;
use stillpoint_pipeline::config::schema::schema;

use crate::exit::{Ended, Exit, print_json};

/// Print the JSON Schema of pipeline files.
#[derive(Args)]
pub struct Schema {}

impl Schema {
    /// Executes the subcommand.
    pub fn execute(&self, registry: &Registry) -> Ended {
        print_json(&schema(registry))?;
        Ok(Exit::Done)
    }
}
