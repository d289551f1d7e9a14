//! `stillpoint bench failsafe`: how long it takes from the last order to the safe state when something dies or stops.

use std::path::Path;

use clap::Args;
use serde::Serialize;
use stillpoint_pipeline::operator::Registry;

use super::casualty::{Fault, Trial};
use super::figures::median;
use super::folder::Folder;
use crate::exit::{Ended, Exit, Failure, print_json};

/// From the last order that arrived, or from when the pose is stale, to the safe state, ms.
const LIMIT_MS: f64 = 100.0;
/// How long a pose is fresh: three frame periods, ms.
const FRESH_MS: f64 = 300.0;

/// Run the example from camera to valve, live, and kill or stop one of its processes, or flood it with datagrams, at a
/// random moment; then say from the session how long it took from the last order that arrived, or from when the pose was
/// stale, until the far end vented and the rig's valves were safe: inlets shut, outlets open.
#[derive(Args)]
pub struct Failsafe {
    /// Trials of each fault.
    #[arg(long, default_value_t = 100)]
    trials: usize,
    /// One fault alone, as the table calls it.
    #[arg(long, value_name = "FAULT")]
    fault: Option<String>,
    /// A short look: one trial of each.
    #[arg(long)]
    quick: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// What is due after a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Due {
    /// Orders end: safe 100 ms after the last one that arrived.
    OrdersEnd,
    /// The pose grows stale: safe 100 ms after three frame periods, unless poses come again before.
    PoseStale,
    /// The valves go on following.
    GoesOn,
}

#[derive(Serialize)]
struct Row {
    fault: String,
    due: Due,
    trials: usize,
    safe: usize,
    /// From the last order, or from when the pose was stale, to the far end's venting, ms.
    ordered_ms: [f64; 2],
    /// The same to the rig's valves being safe, ms.
    valves_ms: [f64; 2],
    /// To the end of the beam, ms.
    beam_ms: [f64; 2],
    first_failure: Option<String>,
}

impl Failsafe {
    /// Does it.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let folder = Folder::create(None)?;
        let trials = if self.quick { 1 } else { self.trials.max(1) };
        let chosen = |f: &&Fault| self.fault.as_ref().is_none_or(|name| *name == f.name());
        let faults: Vec<&Fault> = Fault::ALL.iter().filter(chosen).collect();
        if faults.is_empty() {
            let names: Vec<String> = Fault::ALL.iter().map(Fault::name).collect();
            return Err(Failure::wrong(format!(
                "stillpoint: there is no such fault; there are {}",
                names.join(", ")
            )));
        }
        let mut rows = Vec::new();
        for fault in faults {
            rows.push(row(*fault, trials, &folder.free("failsafe")?, registry)?);
        }
        if self.json {
            print_json(&rows)?;
        } else {
            print(&rows);
        }
        Ok(if rows.iter().all(|r| r.safe == r.trials) { Exit::Done } else { Exit::Failed })
    }
}

fn row(fault: Fault, trials: usize, folder: &Path, registry: &Registry) -> Result<Row, Failure> {
    let (mut ordered, mut valves, mut beam) = (Vec::new(), Vec::new(), Vec::new());
    let (mut safe, mut first_failure) = (0, None);
    for number in 0..trials {
        let trial = Trial::of(fault, number as u64, folder, registry)?;
        let from = match fault.due() {
            Due::PoseStale => trial.last_pose_ms + FRESH_MS,
            _ => trial.last_order_ms,
        };
        let since = |at: Option<f64>| at.map(|at| at - from);
        let good = match fault.due() {
            Due::GoesOn => trial.vents_ms.is_none(),
            // A stage that comes back before its pose is missed for too long needs no safe state.
            Due::PoseStale if trial.vents_ms.is_none() => trial.last_pose_ms > 0.0,
            _ => since(trial.valves_ms).is_some_and(|ms| ms <= LIMIT_MS) && trial.beam_ms <= trial.vents_ms,
        };
        safe += usize::from(good);
        if !good && first_failure.is_none() {
            first_failure = Some(format!("trial {number}: {trial:?}"));
        }
        ordered.extend(since(trial.vents_ms));
        valves.extend(since(trial.valves_ms));
        beam.extend(since(trial.beam_ms));
    }
    Ok(Row {
        fault: fault.name(),
        due: fault.due(),
        trials,
        safe,
        ordered_ms: spread(&ordered),
        valves_ms: spread(&valves),
        beam_ms: spread(&beam),
        first_failure,
    })
}

/// Median and greatest; NaN where there is nothing.
fn spread(all: &[f64]) -> [f64; 2] {
    if all.is_empty() {
        return [f64::NAN; 2];
    }
    [median(all), all.iter().copied().fold(f64::NEG_INFINITY, f64::max)]
}

fn print(rows: &[Row]) {
    println!(
        "{:<18} {:>6} {:>6}   {:>16} {:>16} {:>16}   median and greatest, ms",
        "fault", "trials", "safe", "far end vents", "valves safe", "beam off"
    );
    let pair = |[m, w]: [f64; 2]| if m.is_nan() { "-".to_owned() } else { format!("{m:.0}, {w:.0}") };
    for r in rows {
        println!(
            "{:<18} {:>6} {:>6}   {:>16} {:>16} {:>16}   {}",
            r.fault,
            r.trials,
            r.safe,
            pair(r.ordered_ms),
            pair(r.valves_ms),
            pair(r.beam_ms),
            match r.due {
                Due::OrdersEnd => "since the last order",
                Due::PoseStale => "since three frames after the last pose",
                Due::GoesOn => "goes on",
            }
        );
        if let Some(failure) = &r.first_failure {
            println!("  {failure}");
        }
    }
}
