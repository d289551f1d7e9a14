//! `stillpoint bench failsafe`: the time from the last order to the safe state after a fault.

use std::path::Path;

use clap::Args;
use serde::Serialize;
use stillpoint_operator::Registry;

use super::evidence::Vent;
use super::fault_trial::{Due, Fault, Trial};
use super::figures::median;
use super::folder::Folder;
use stillpoint::jobs;
use stillpoint::{Ended, Exit, Failure, print_json};

/// Maximum time to the safe state, ms: from the last order that arrived or was followed, or from when the pose is
/// stale.
const LIMIT_MS: f64 = 100.0;
/// Time after which a pose is stale: three frame periods, ms.
const FRESH_MS: f64 = 300.0;
/// The far end and the rig simulate hardware with its own processors. A failed trial is not valid if one of them stood
/// still for longer than this time, ms, and one of them waited for a core for as long by the count of the kernel.
const STOOD_MS: f64 = 10.0;
/// Trials that are not valid are repeated, up to this factor times the requested number of trials.
const TRIES: usize = 3;

/// Run the default pipeline live, and cause a fault at a random moment: kill or stop a process, silence the camera,
/// make the pose non-finite, or flood the run with datagrams. Report from the session the time from the last order that
/// arrived, or from when the pose was stale, until the far end vented and the valves of the rig were safe: inlets shut,
/// outlets open. The session has to state the reason, and after the fault the valves have to follow without a jump of
/// the duties.
#[derive(Args)]
pub struct Failsafe {
    /// Number of trials of each fault.
    #[arg(long, default_value_t = 100, value_parser = super::at_least::<usize>(1))]
    trials: usize,
    /// Try only this fault, by its name in the table.
    #[arg(long, value_name = "FAULT")]
    fault: Option<String>,
    /// Number of faults that are tried at the same time, each in a separate run.
    #[arg(long, default_value_t = 1, value_parser = super::at_least::<usize>(1))]
    threads: usize,
    /// A short measurement: one trial of each fault.
    #[arg(long)]
    quick: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Row {
    fault: String,
    due: Due,
    trials: usize,
    safe: usize,
    /// Number of trials that were repeated, because the far end or the rig got no core.
    starved: usize,
    /// Time from the last order, or from when the pose was stale, until the far end vented, ms: median and maximum.
    ordered_ms: [f64; 2],
    /// The same until the valves of the rig were safe, ms.
    valves_ms: [f64; 2],
    /// The same until the beam was off, ms.
    beam_ms: [f64; 2],
    first_failure: Option<String>,
}

impl Failsafe {
    /// Runs the trials and prints their times. Fails if a trial did not have the required reaction.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let folder = Folder::create(None)?;
        let trials = if self.quick { 1 } else { self.trials };
        let chosen = |f: &&Fault| self.fault.as_ref().is_none_or(|name| *name == f.name());
        let faults: Vec<&Fault> = Fault::ALL.iter().filter(chosen).collect();
        if faults.is_empty() {
            let names: Vec<String> = Fault::ALL.iter().map(|f| f.name()).collect();
            return Err(Failure::wrong(format!("there is no such fault; there are {}", names.join(", "))));
        }
        let jobs = faults.into_iter().map(|fault| Ok((*fault, folder.free(&fault.name())?)));
        let jobs = jobs.collect::<Result<Vec<_>, Failure>>()?;
        let rows =
            jobs::each(&jobs, self.threads, |(fault, folder)| Ok(row(*fault, trials, folder, registry)))?;
        if self.json {
            print_json(&rows)?;
        } else {
            print(&rows);
        }
        Ok(if rows.iter().all(|r| r.safe == r.trials) { Exit::Done } else { Exit::Failed })
    }
}

fn row(fault: Fault, trials: usize, folder: &Path, registry: &Registry) -> Row {
    let (mut ordered, mut valves, mut beam) = (Vec::new(), Vec::new(), Vec::new());
    let (mut safe, mut starved, mut first_failure) = (0, 0, None);
    let mut number = 0;
    while number < trials + starved {
        let trial = Trial::of(fault, number as u64, folder, registry);
        number += 1;
        let trial = match trial {
            Ok(trial) => trial,
            Err(e) => {
                first_failure.get_or_insert(format!("trial {number}: {}", e.text));
                continue;
            }
        };
        let e = &trial.evidence;
        let from = match fault.due() {
            Due::PoseStale => e.last_pose_ms + FRESH_MS,
            Due::FollowingEnds => e.last_followed_ms,
            _ => e.last_order_ms,
        };
        let since = |at: Option<f64>| at.map(|at| at - from);
        let ends = since(e.valves_ms).is_some_and(|ms| ms <= LIMIT_MS) && e.beam_ms <= e.vents_ms;
        let in_time = match fault.due() {
            Due::GoesOn => e.vents_ms.is_none(),
            // A late order that is still in time ends a vent before the valves have moved.
            Due::GoesOnOrEnds => {
                let in_time = |vent: &Vent| {
                    let within = |at: Option<f64>| at.is_some_and(|at| at - vent.order_ms <= LIMIT_MS);
                    within(vent.valves_ms) || within(vent.follows_ms)
                };
                e.vents.iter().all(in_time) && (e.vents_ms.is_none() || e.beam_ms <= e.vents_ms)
            }
            _ => ends,
        };
        let good = in_time && e.jump.is_none() && trial.came_back != Some(false) && trial.says_why(fault);
        // A flood is itself the reason why the far end waits for a core. So such a trial counts.
        let no_core = e.bedside_stood_ms > STOOD_MS && trial.bedside_waited_ms > STOOD_MS;
        if !good && no_core && !fault.is_flood() && starved < (TRIES - 1) * trials {
            starved += 1;
            continue;
        }
        safe += usize::from(good);
        if !good && first_failure.is_none() {
            let why = if trial.says_why(fault) { "" } else { "the session does not say why; " };
            first_failure = Some(format!("trial {number}: {why}{trial:?}"));
        }
        ordered.extend(since(e.vents_ms));
        valves.extend(since(e.valves_ms));
        beam.extend(since(e.beam_ms));
    }
    Row {
        fault: fault.name(),
        due: fault.due(),
        trials,
        safe,
        starved,
        ordered_ms: spread(&ordered),
        valves_ms: spread(&valves),
        beam_ms: spread(&beam),
        first_failure,
    }
}

/// Median and maximum; NaN if there are no times.
fn spread(all: &[f64]) -> [f64; 2] {
    if all.is_empty() {
        return [f64::NAN; 2];
    }
    [median(all), all.iter().copied().fold(f64::NEG_INFINITY, f64::max)]
}

fn print(rows: &[Row]) {
    outln!(
        "{:<18} {:>6} {:>6} {:>7}   {:>16} {:>16} {:>16}   median and greatest, ms",
        "fault",
        "trials",
        "safe",
        "starved",
        "far end vents",
        "valves safe",
        "beam off"
    );
    let pair = |[m, w]: [f64; 2]| if m.is_nan() { "-".to_owned() } else { format!("{m:.0}, {w:.0}") };
    for r in rows {
        outln!(
            "{:<18} {:>6} {:>6} {:>7}   {:>16} {:>16} {:>16}   {}",
            r.fault,
            r.trials,
            r.safe,
            r.starved,
            pair(r.ordered_ms),
            pair(r.valves_ms),
            pair(r.beam_ms),
            match r.due {
                Due::OrdersEnd => "since the last order",
                Due::PoseStale => "since three frames after the last pose",
                Due::FollowingEnds => "since an order was last followed",
                Due::GoesOn => "goes on",
                Due::GoesOnOrEnds => "goes on, or since the last order that got through",
            }
        );
        if let Some(failure) = &r.first_failure {
            outln!("  {failure}");
        }
    }
}
