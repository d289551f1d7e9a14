//! `stillpoint check`

use std::path::{Path, PathBuf};

use clap::Args;
use stillpoint_operator::Registry;
use stillpoint_pipeline::config::Machine;
use stillpoint_pipeline::graph::Graph;
use stillpoint_recorder::Session;

use crate::exit::{Ended, Exit, print_json};
use crate::pipeline_file::PipelineFile;
use crate::rates::of_session;
use crate::recorded::with_topics;
use crate::summary::judged;
use crate::{determinism, differences};

/// Check a pipeline for this machine and show all its faults.
#[derive(Args)]
pub struct Check {
    #[command(flatten)]
    pipeline: PipelineFile,
    /// Print the whole pipeline: with what it includes, defaults, variables and arguments, and where each value came from. The
    /// output is a pipeline file.
    #[arg(long, conflicts_with = "against")]
    resolved: bool,
    /// Judge the contracts of the pipeline by the times of this session, and print what would help.
    #[arg(long, value_name = "SESSION")]
    against: Option<PathBuf>,
    /// Run the pipeline twice in simulated time, and compare all samples: what differs depends on a clock, on an order that is
    /// not fixed, or on random numbers that no seed gives. The command ends with 3 if the runs differ.
    #[arg(long, conflicts_with_all = ["against", "resolved"])]
    determinism: bool,
    /// Length of each of these runs in session time.
    #[arg(long = "for", value_name = "TIME", default_value = "10s", requires = "determinism")]
    length: String,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Check {
    /// Executes the subcommand.
    pub fn execute(&self, registry: &Registry) -> Ended {
        if self.resolved {
            return self.resolve(registry);
        }
        let graph = match self.pipeline.check(registry, &Machine::here()) {
            Ok(checked) => checked.graph,
            Err(refused) => return refused.end(self.json),
        };
        if let Some(path) = &self.against {
            return self.judge(&graph, path);
        }
        if self.determinism {
            return self.compare(&graph, registry);
        }
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

    /// Prints all values of the pipeline.
    fn resolve(&self, registry: &Registry) -> Ended {
        let resolved = match self.pipeline.resolve(registry, &Machine::here()) {
            Ok(resolved) => resolved,
            Err(refused) => return refused.end(self.json),
        };
        let graph = &resolved.graph;
        if self.json {
            let order: Vec<_> = graph.operators.iter().map(|o| o.name.as_str()).collect();
            print_json(&serde_json::json!({
                "pipeline": graph.name, "operators": order, "faults": [], "values": resolved.to_json(),
            }))?;
        } else {
            out!("{}", resolved.to_yaml());
        }
        Ok(Exit::Done)
    }

    /// Runs the pipeline twice: done if the runs are the same.
    fn compare(&self, graph: &Graph, registry: &Registry) -> Ended {
        let found = determinism::of_two_runs(&self.pipeline, &self.length, registry)?;
        let is_same = found.is_identical();
        if self.json {
            print_json(&serde_json::json!({
                "pipeline": graph.name, "faults": [], "deterministic": is_same, "differences": found,
            }))?;
            return Ok(if is_same { Exit::Done } else { Exit::Differs });
        }
        if is_same {
            outln!(
                "{}: two runs of {} are the same, to the bit, in {} topics",
                graph.name,
                self.length,
                found.topics.len()
            );
            return Ok(Exit::Done);
        }
        differences::print(&found, ["first run", "second run"]);
        outln!("{}: two runs of {} differ", graph.name, self.length);
        Ok(Exit::Differs)
    }

    /// Judges the contracts by the times of a session: done if all of them hold.
    fn judge(&self, graph: &Graph, path: &Path) -> Ended {
        let session = with_topics(Session::open(path), path)?;
        let judged = judged(&session, graph);
        let is_broken = judged.iter().any(|c| c.is_broken);
        if self.json {
            print_json(&serde_json::json!({
                "pipeline": graph.name, "faults": [], "of": of_session(path), "contracts": judged,
            }))?;
        } else if judged.is_empty() {
            outln!("{}: the pipeline has no contracts", graph.name);
        }
        for contract in judged.iter().filter(|_| !self.json) {
            outln!("{}{contract}", if contract.is_broken { "BROKEN: " } else { "kept: " });
            contract.advice.iter().for_each(|advice| outln!("  {advice}"));
        }
        Ok(if is_broken { Exit::Failed } else { Exit::Done })
    }
}
