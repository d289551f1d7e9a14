//! `stillpoint plan`: beams and fluence for a case.
//!
//! - `args`: the arguments; `request`: the same, checked
//! - `arc`: the plan of a patient in arcs
//! - `patient`: the plan of one patient; `queue`: those of many
//! - `prepared`: the doses of the beams, from the cache
//! - `leaves`: the segments of a plan
//! - `search`: the searches, with their progress
//! - `pooled`: doses and solves on a pool of workers
//! - `outcome`: what a plan gives
//! - `table`: figures for people
//! - `page`: plan.html
//! - `compare`: two plans side by side
//! - `charts`: histograms and searches as SVG; `tree`: the sets that a search went through
//! - `export`: RTPLAN, RTDOSE and RTSTRUCT
//! - `folder`: the files of a plan
//! - `recalculate`: the dose of an RTPLAN of any program
//! - `matrix`, `weights`: the dose matrix for other optimisers, and weights of theirs

mod arc;
mod args;
mod charts;
mod compare;
mod export;
mod folder;
mod leaves;
mod matrix;
mod outcome;
mod page;
mod patient;
mod pooled;
mod prepared;
mod queue;
mod recalculate;
mod request;
mod search;
mod table;
mod tree;
mod weights;

use std::num::NonZeroUsize;

use clap::{Args, Subcommand};
use serde_json::json;

use crate::exit::{Ended, Failure, print_json};
use args::PlanArgs;
use patient::Made;
use queue::Queue;
use request::Patient;

pub(super) use charts::percent_curve;
pub(super) use prepared::bar;
pub(super) use request::machine as machine_of;

/// Choose the beams of a case and optimise their fluence.
///
/// Without a case, the synthetic pelvis of seed 0 is planned. Several cases are a queue: each is planned as if it were alone,
/// and the output is a table. A case whose plan failed does not stop the others, and a plan that an earlier call finished with
/// the same case, arguments and build is not made again: the file request.json in its folder records them. Without --angles and --couch, beams stand at least 20 degrees apart on a ring of 90 angles.
/// The output is a folder: plan.json, plan.html, dvh.svg, objective.svg, tree.svg where sets were solved from other sets, the dose over the slices through the isocentre (PNG),
/// rtplan.dcm, rtdose.dcm, and rtstruct.dcm where the case did not come from DICOM. No plan of this command may be used to treat a patient.
#[derive(Args)]
#[command(args_conflicts_with_subcommands = true)]
pub struct Plan {
    #[command(subcommand)]
    action: Option<Action>,
    #[command(flatten)]
    args: PlanArgs,
}

#[derive(Subcommand)]
enum Action {
    /// Show two plans of one case side by side.
    Compare(compare::Compare),
    Export(matrix::Export),
    Evaluate(matrix::Evaluate),
    Recalculate(recalculate::Recalculate),
}

impl Plan {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        let report = |made: Made<'_>, as_json| if as_json { print_as_json(&made) } else { print(&made) };
        match &self.action {
            Some(Action::Compare(compare)) => return compare.execute(),
            Some(Action::Export(export)) => return export.execute(),
            Some(Action::Recalculate(recalculate)) => return recalculate.execute(),
            Some(Action::Evaluate(evaluate)) => return evaluate.execute(report),
            None => {}
        }
        let args = &self.args;
        let threads =
            args.threads.or_else(|| std::thread::available_parallelism().ok()).unwrap_or(NonZeroUsize::MIN);
        let case = match &args.cases[..] {
            [] => None,
            [case] => Some(case.as_path()),
            cases if args.start.is_some() => {
                return Err(Failure::wrong(format!(
                    "{} cases are given: give one with --start",
                    cases.len()
                )));
            }
            cases => {
                if let Some(arcs) = &args.arc {
                    arc::read(arcs)?;
                }
                return Queue::new(args, cases, threads)?.execute();
            }
        };
        let patient = Patient { case, out: args.out.clone(), threads, is_quiet: args.json, weights: None };
        if let Some(arcs) = &args.arc {
            return arc::plan(args, &patient, arcs)?.report(args.json);
        }
        patient::plan(args, &patient, |made| report(made, args.json))
    }
}

fn print_as_json(made: &Made<'_>) -> Result<(), Failure> {
    let plan = made.outcome.file(made.request, made.prepared, &made.runs.0).map_err(Failure::failed)?;
    let mut reported = serde_json::to_value(plan).map_err(Failure::failed)?;
    if let Some(reported) = reported.as_object_mut() {
        let seconds = json!({ "doses": made.doses_s, "choice": made.chosen_s, "all": made.all_s });
        reported.insert("files".to_owned(), json!(made.files));
        reported.insert("seconds".to_owned(), seconds);
    }
    print_json(&reported)
}

fn print(made: &Made<'_>) -> Result<(), Failure> {
    let Made { doses_s, chosen_s, .. } = made;
    table::print(made.request, made.prepared, (&made.runs.0, &made.runs.1), made.outcome);
    let rest_s = made.all_s - doses_s - chosen_s;
    outln!(
        "\ntime: doses {doses_s:.1} s, search and fluence {chosen_s:.1} s, final dose and files {rest_s:.1} s"
    );
    for file in &made.files {
        outln!("{}", file.display());
    }
    Ok(())
}
