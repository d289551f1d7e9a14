//! `stillpoint replay --set`: a session with a changed pipeline.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use stillpoint_operator::Registry;
use stillpoint_pipeline::what_if::{StepTimes, WhatIf};
use stillpoint_recorder::{Compression, Session};
use stillpoint_report::compare::Choice;

use super::diff::{Align, write_page};
use super::sweep::Sweep;
use crate::differences;
use crate::exit::{Ended, Failure, print_json};
use crate::rerun::{Computed, Rerun, RerunError};
use crate::signals::stop_flag_of_this_process;

/// The changes with which a session runs again.
#[derive(Args, Default)]
pub struct WhatIfArgs {
    /// Change a parameter, the period (`law.every`), the kind (`law.use`) or an input (`law.inputs.state`) of an operator,
    /// and run the session again from the first change on.
    #[arg(long = "set", value_name = "OPERATOR.PARAM=VALUE", conflicts_with_all = ["only", "from"])]
    sets: Vec<String>,
    /// Run the session once for each of COUNT evenly spaced values of a parameter, on all cores, and print how the figures of
    /// the end depend on it, such as `--sweep "law.proportional=1..5 1/s/9"`. `--page` draws their curves.
    #[arg(long, value_name = "OPERATOR.PARAM=FROM..TO/COUNT", conflicts_with_all = ["only", "from", "record", "align"])]
    sweep: Option<Sweep>,
    /// The changed pipeline, instead of the one that the session keeps; `--set` is applied to it. Files that it names are
    /// those of the session, and where the session has none of that name, those next to FILE.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["only", "from"])]
    with: Option<PathBuf>,
    /// Run this operator and all that is downstream of it again, though it is not changed.
    #[arg(long, value_name = "OPERATOR", conflicts_with_all = ["only", "from"])]
    rerun: Vec<String>,
    /// Take this operator from the recording, though a change reaches it.
    #[arg(long, value_name = "OPERATOR")]
    hold: Vec<String>,
    /// The times that steps take; the default is `measured`.
    #[arg(long, value_enum)]
    latencies: Option<Latencies>,
    /// How samples are paired for the table; the default is `auto`, as for `stillpoint diff`.
    #[arg(long, value_enum)]
    align: Option<Align>,
    /// Write a page with both runs in each chart.
    #[arg(long, value_name = "FILE")]
    page: Option<PathBuf>,
}

/// The times that steps take.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Latencies {
    /// Those that the session measured; the declared ones where it measured none.
    Measured,
    /// Those that the pipeline declares.
    Declared,
}

impl WhatIfArgs {
    /// Whether the session runs again with a change.
    pub fn is_asked(&self) -> bool {
        !self.sets.is_empty() || self.with.is_some() || !self.rerun.is_empty() || self.sweep.is_some()
    }

    /// Refuses what only a change gives a meaning.
    pub fn check(&self) -> Result<(), Failure> {
        let alone = [
            ("--hold", !self.hold.is_empty()),
            ("--latencies", self.latencies.is_some()),
            ("--align", self.align.is_some()),
            ("--page", self.page.is_some()),
        ];
        match alone.into_iter().find(|(_, given)| *given && !self.is_asked()) {
            Some((name, _)) => {
                Err(Failure::wrong(format!("{name} needs a change: give --set, --sweep, --with or --rerun")))
            }
            None => Ok(()),
        }
    }

    /// Runs the session again with the changes, and prints what is different.
    pub fn execute(
        &self,
        path: &Path,
        session: &Session,
        registry: &Registry,
        record: Option<&Path>,
        compression: Compression,
        is_json: bool,
    ) -> Ended {
        let rerun = Rerun {
            sets: self.sets.clone(),
            with: self.with.clone(),
            rerun: self.rerun.clone(),
            hold: self.hold.clone(),
            step_times: match self.latencies {
                Some(Latencies::Declared) => StepTimes::Declared,
                Some(Latencies::Measured) | None => StepTimes::Measured,
            },
            align: self.align.map_or(Choice::Auto, Choice::from),
            record: record.map(Path::to_path_buf),
            compression,
        };
        if let Some(sweep) = &self.sweep {
            return sweep.execute((path, session), registry, &rerun, self.page.as_deref(), is_json);
        }
        let computed = match rerun.compute(session, registry, stop_flag_of_this_process()?) {
            Ok(computed) => computed,
            Err(RerunError::Refused(refused)) => return refused.end(false),
            Err(RerunError::Failed(failure)) => return Err(failure),
        };
        let Computed { done, comparison, operators, wall_seconds } = &computed;
        let names = ["recorded", "changed"];
        if let Some(page) = &self.page {
            let changes: Vec<String> = done.changes.iter().map(ToString::to_string).collect();
            write_page(page, comparison, names, &changes)?;
        }
        let exit = computed.exit();
        if is_json {
            print_json(&computed.to_json(path, record))?;
            return Ok(exit);
        }
        self.say(done, *operators);
        differences::print(comparison, names);
        if let Some(folder) = record {
            outln!("session: {}", folder.display());
        }
        let speed = done.report.seconds / wall_seconds.max(1e-9);
        outln!("{:.1} s of session in {wall_seconds:.2} s ({speed:.1}x real time)", done.report.seconds);
        Ok(exit)
    }

    /// Says what was changed, and what was computed from it.
    fn say(&self, done: &WhatIf, operators: usize) {
        for change in &done.changes {
            outln!("change: {change}");
        }
        if done.changes.is_empty() && self.rerun.is_empty() {
            outln!("no change: the recording has these values");
        }
        let reach = &done.reach;
        if !reach.decided.is_empty() {
            let count = reach.decided.len();
            outln!("computed again: {} ({count} of {operators} operators)", reach.decided.join(", "));
            match reach.rigs.as_slice() {
                [] => outln!(
                    "open loop: the sensors are recorded, so the recorded patient does not react to the change"
                ),
                rigs => outln!(
                    "closed loop: the simulated patient ({}) runs again with its seed",
                    rigs.join(", ")
                ),
            }
        }
        if !reach.held.is_empty() {
            outln!("held, because what they say was recorded and does not react: {}", reach.held.join(", "));
        }
        match done.measured.len() {
            0 => outln!("step times: as declared"),
            n => outln!("step times: measured by the session for {n} operators, else as declared"),
        }
        for open in done.open() {
            outln!(
                "{}, incarnation {}, cannot be computed from activation {} on: {}",
                open.operator,
                open.incarnation,
                open.from_activation,
                open.reason
            );
        }
        if let Some(first) = &done.replayed.first_difference {
            outln!(
                "the recorded part does not replay: {} differences, the first: {first}",
                done.replayed.differences
            );
        }
        for fault in done.report.faults.iter().take(5) {
            outln!("{} failed: {}", fault.operator, fault.reason);
        }
        if let Some(reason) = &done.report.ended_early {
            outln!("ended early: {reason}");
        }
    }
}
