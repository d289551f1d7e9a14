//! `stillpoint plan`: beams and fluence for a case.
//!
//! - `args`: the arguments; `request`: the same, checked
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

mod args;
mod charts;
mod compare;
mod export;
mod folder;
mod leaves;
mod outcome;
mod page;
mod patient;
mod pooled;
mod prepared;
mod queue;
mod request;
mod search;
mod table;
mod tree;

use std::num::NonZeroUsize;

use serde_json::json;

use crate::exit::{Ended, Failure, print_json};
use args::Action;
use patient::{Made, Patient};
use queue::Queue;

pub use args::Plan;
pub(super) use charts::percent_curve;
pub(super) use prepared::bar;
pub(super) use request::machine as machine_of;

impl Plan {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        if let Some(Action::Compare(compare)) = &self.action {
            return compare.execute();
        }
        let args = &self.args;
        let threads =
            args.threads.or_else(|| std::thread::available_parallelism().ok()).unwrap_or(NonZeroUsize::MIN);
        let case = match &args.cases[..] {
            [] => None,
            [case] => Some(case.as_path()),
            cases => return Queue::new(args, cases, threads)?.execute(),
        };
        let patient = Patient { case, out: args.out.clone(), threads, is_quiet: args.json };
        patient::plan(args, &patient, |made| if args.json { print_as_json(&made) } else { print(&made) })
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
