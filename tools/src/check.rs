//! `stillpoint check`

use clap::Args;
use stillpoint_pipeline::operator::Registry;
use stillpoint_pipeline::spec::Machine;

use crate::exit::{Ended, Exit, Failure, print_json};
use crate::pipeline_file::PipelineFile;

/// Check a pipeline for this machine and show every fault of it.
#[derive(Args)]
pub struct Check {
    #[command(flatten)]
    pipeline: PipelineFile,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Check {
    /// Does it.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let source = self.pipeline.read()?;
        match self.pipeline.check_source(&source, registry, &Machine::here()) {
            Ok(graph) => {
                if self.json {
                    let order: Vec<_> = graph.operators.iter().map(|o| o.name.as_str()).collect();
                    print_json(
                        &serde_json::json!({ "pipeline": graph.name, "operators": order, "faults": [] }),
                    )?;
                } else {
                    println!(
                        "{}: {} operators in {} processes, no faults",
                        graph.name,
                        graph.operators.len(),
                        graph.processes.len()
                    );
                }
                Ok(Exit::Done)
            }
            Err(faults) if self.json => {
                print_json(&faults.to_json())?;
                Ok(Exit::Wrong)
            }
            Err(faults) => Err(Failure::wrong(faults)),
        }
    }
}
