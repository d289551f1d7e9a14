//! `stillpoint plan`: beams and fluence for a case.
//!
//! - `args`: the arguments; `request`: the same, checked
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
mod pooled;
mod prepared;
mod request;
mod search;
mod table;
mod tree;

use std::time::Instant;

use serde_json::json;
use stillpoint_plan::recipe::PlanRun;

use crate::exit::{Ended, Exit, Failure, print_json};
use args::Action;
use outcome::Outcome;
use pooled::Pooled;
use prepared::Prepared;
use request::Request;

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
        let request = Request::new(args)?;
        folder::make_ready(&request.out)?;
        let began = Instant::now();
        let mut pooled = args.pool.open()?.map(Pooled::new);
        let (prepared, (runs, run_s), ready_s) = loop {
            let begun = Instant::now();
            let prepared = Prepared::new(&request, pooled.as_mut())?;
            let ready_s = begun.elapsed().as_secs_f64();
            if !args.json {
                prepared.print_notes(&request);
            }
            let runs = search::all(&request, &prepared, pooled.as_mut())?;
            let Some(pooled) = &mut pooled else { break (prepared, runs, ready_s) };
            pooled.print_news();
            if !pooled.is_in_doubt(&request.doses, request.setup.engines())? {
                if !args.json {
                    pooled.print_notes();
                }
                break (prepared, runs, ready_s);
            }
            errln!("pool: the plan is made again without the answers of workers that were shut out");
        };
        let (Some(best), chosen_s) = (best(&runs), began.elapsed().as_secs_f64() - ready_s) else {
            return Err(Failure::failed("no method was run"));
        };
        let outcome = Outcome::new(&request, &prepared, best)?;
        let files = folder::write(&request, &prepared, &runs, &outcome)?;
        let seconds = json!({ "doses": ready_s, "choice": chosen_s, "all": began.elapsed().as_secs_f64() });
        if args.json {
            let plan = outcome.file(&request, &prepared, &runs).map_err(Failure::failed)?;
            let mut reported = serde_json::to_value(plan).map_err(Failure::failed)?;
            if let Some(reported) = reported.as_object_mut() {
                reported.insert("files".to_owned(), json!(files));
                reported.insert("seconds".to_owned(), seconds);
            }
            print_json(&reported)?;
        } else {
            table::print(&request, &prepared, (&runs, &run_s), &outcome);
            let rest_s = began.elapsed().as_secs_f64() - ready_s - chosen_s;
            outln!(
                "\ntime: doses {ready_s:.1} s, search and fluence {chosen_s:.1} s, final dose and files {rest_s:.1} s"
            );
            for file in files {
                outln!("{}", file.display());
            }
        }
        Ok(if outcome.is_refused(&request) { Exit::Refused } else { Exit::Done })
    }
}

/// The run with the least cost, the first among equals.
fn best(runs: &[PlanRun]) -> Option<&PlanRun> {
    runs.iter().reduce(|a, b| if b.choice.best.cost < a.choice.best.cost { b } else { a })
}
