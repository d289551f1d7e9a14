//! `stillpoint check`

use clap::Args;
use stillpoint_operator::Registry;
use stillpoint_pipeline::config::Machine;

use crate::exit::{Ended, Exit, print_json};
use crate::pipeline_file::PipelineFile;

/// Check a pipeline for this machine and show all its faults.
#[derive(Args)]
pub struct Check {
    #[command(flatten)]
    pipeline: PipelineFile,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Check {
    /// Executes the subcommand.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let graph = match self.pipeline.check(registry, &Machine::here()) {
            Ok(checked) => checked.graph,
            Err(refused) => return refused.end(self.json),
        };
        if self.json {
            let order: Vec<_> = graph.operators.iter().map(|o| o.name.as_str()).collect();
            print_json(&serde_json::json!({ "pipeline": graph.name, "operators": order, "faults": [] }))?;
        } else {
            let operators = match graph.operators.len() {
                1 => "1 operator".to_string(),
                many => format!("{many} operators"),
            };
            let processes = match graph.processes.len() {
                1 => "1 process".to_string(),
                many => format!("{many} processes"),
            };
            outln!("{}: {operators} in {processes}, no faults", graph.name);
        }
        Ok(Exit::Done)
    }
}
