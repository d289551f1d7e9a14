//! `stillpoint doctor`

use std::collections::BTreeSet;
use std::path::PathBuf;

use clap::Args;
use serde_json::json;
use stillpoint_operator::Registry;
use stillpoint_pipeline::config::Machine;
use stillpoint_pipeline::live::run_folder::{going_on, sweep_dead};

use super::bridge;
use super::hz::watched;
use crate::attach::Which;
use crate::doctor::settings::Kernel;
use crate::doctor::{Finding, Verdict, camera, latency, limits, wakeup};
use crate::exit::{Ended, Exit, Failure, print_json};
use crate::pipeline_file::PipelineFile;

/// Measure whether this machine will hold a pipeline: priority, wake-ups, clocks, cores, shared memory, limits, disk, ports,
/// cameras of ROS 2.
///
/// Exit codes: 0 all is well; 1 a setting is not known, or could be better; 2 the pipeline will not hold.
#[derive(Args)]
pub struct Doctor {
    #[command(flatten)]
    pipeline: PipelineFile,
    /// How long wake-ups are measured: by this program, then by `cyclictest` and `rtla` where they are installed. Then
    /// cameras of ROS 2 are listened to, as long.
    #[arg(long = "for", value_name = "TIME", default_value = "10s")]
    time: String,
    /// Folder in which sessions are to be recorded.
    #[arg(long, value_name = "FOLDER", default_value = "sessions")]
    record: PathBuf,
    /// Remove what dead runs left.
    #[arg(long)]
    clean: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Doctor {
    /// Executes the subcommand.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let time = watched(&self.time)?;
        let checked = match self.pipeline.check(registry, &Machine::here()) {
            Ok(checked) => checked,
            Err(refused) => return refused.end(self.json),
        };
        let cleaned = if self.clean { sweep_dead().map_err(Failure::failed)? } else { Vec::new() };
        let graph = &checked.graph;
        let bound: BTreeSet<usize> = graph.processes.iter().filter_map(|p| p.core).collect();
        let asked = limits::asked(graph);
        let mut findings = vec![limits::priority(asked)];
        let runs = going_on().unwrap_or_default();
        for card in &runs {
            // A run of another build cannot be joined, and is left out.
            if let Ok(run) = (Which { run: Some(card.pid.to_string()) }).attach(registry) {
                findings.extend(limits::granted(&run));
            }
        }
        // The ends of links poll; they hold no period.
        let shortest = graph.operators.iter().filter(|o| o.far_end.is_none()).filter_map(|o| o.every).min();
        findings.extend(wakeup::measure(time).findings(shortest));
        findings.extend(latency::measure(time, asked.level(), shortest));
        findings.push(limits::cores(graph));
        findings.extend(Kernel::here().findings(&bound, asked.level().is_some()));
        findings.push(limits::shared_memory(graph));
        findings.push(limits::open_files(graph));
        findings.push(limits::disk(&self.record));
        // The ports of a run that is going on are its own.
        if runs.is_empty() {
            findings.extend(limits::ports(graph));
        }
        findings.push(limits::leftovers());
        if !graph.hosts.is_empty() || graph.ros2.is_some() || !graph.pools.is_empty() {
            findings.push(versions());
        }
        // Without the program, its version says so.
        if let Ok(program) = bridge::command() {
            findings.extend(camera::rates(graph, time, program));
        }
        let worst = findings.iter().map(|f| f.verdict).max().unwrap_or(Verdict::Good);
        if self.json {
            print_json(&json!({
                "pipeline": graph.name, "verdict": worst, "findings": findings, "cleaned": cleaned,
            }))?;
        } else {
            cleaned.iter().for_each(|id| outln!("removed the leftovers of the dead run {id}"));
            findings.iter().for_each(print);
            outln!("{}: {}", graph.name, words(worst));
        }
        Ok(match worst {
            Verdict::Good => Exit::Done,
            Verdict::Unknown => Exit::Failed,
            Verdict::Bad => Exit::Wrong,
        })
    }
}

fn words(worst: Verdict) -> &'static str {
    match worst {
        Verdict::Good => "this machine will hold it",
        Verdict::Unknown => "nothing speaks against it; some settings are not known, or could be better",
        Verdict::Bad => "THIS MACHINE WILL NOT HOLD IT",
    }
}

fn print(finding: &Finding) {
    let mark = match finding.verdict {
        Verdict::Good => "good",
        Verdict::Unknown => "?   ",
        Verdict::Bad => "BAD ",
    };
    outln!("{mark} {}: {} (required: {})", finding.setting, finding.found, finding.requested);
    if !finding.mend.is_empty() {
        let lasts = if finding.survives_reboot { "survives a reboot" } else { "until the next reboot" };
        outln!("     mend: {} ({lasts})", finding.mend);
    }
}

/// The version of the program that speaks with other hosts, against this one.
fn versions() -> Finding {
    let (setting, own) = ("version of stillpoint-bridge", env!("CARGO_PKG_VERSION"));
    let message = bridge::command().and_then(|mut command| {
        let done = command.arg("--version").output().map_err(Failure::failed)?;
        Ok(String::from_utf8_lossy(&done.stdout).lines().next().unwrap_or_default().to_owned())
    });
    match message {
        Err(e) => Finding::bad(setting, own, "it is not there", e.text).lasting(),
        Ok(message) if message.split_whitespace().any(|word| word == own) => {
            Finding::good(setting, own, message)
        }
        Ok(message) => Finding::bad(setting, own, message, "build both programs from one source").lasting(),
    }
}
