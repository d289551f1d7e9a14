//! The plan of one patient: from the request to the files.

use std::path::PathBuf;
use std::time::Instant;

use stillpoint_plan::recipe::PlanRun;

use super::args::PlanArgs;
use super::folder;
use super::outcome::Outcome;
use super::pooled::Pooled;
use super::prepared::Prepared;
use super::request::{Patient, Request};
use super::search;
use crate::exit::{Ended, Exit, Failure};

/// A plan that was made and written.
pub struct Made<'a> {
    /// The request.
    pub request: &'a Request,
    /// What it was made on.
    pub prepared: &'a Prepared,
    /// The searches, with the seconds that each took.
    pub runs: &'a search::Runs,
    /// What it gives.
    pub outcome: &'a Outcome<'a>,
    /// Its files.
    pub files: Vec<PathBuf>,
    /// Seconds that the doses took.
    pub doses_s: f64,
    /// Seconds that the choice of beams took.
    pub chosen_s: f64,
    /// Seconds of all.
    pub all_s: f64,
}

/// Plans a patient, and reports the plan.
pub fn plan(
    args: &PlanArgs,
    patient: &Patient<'_>,
    report: impl FnOnce(Made<'_>) -> Result<(), Failure>,
) -> Ended {
    let request = Request::new(args, patient)?;
    folder::make_ready(&request.out)?;
    let began = Instant::now();
    let mut pooled = args.pool.open()?.map(Pooled::new);
    let (prepared, runs, doses_s) = loop {
        let begun = Instant::now();
        let prepared = Prepared::new(&request, pooled.as_mut())?;
        let doses_s = begun.elapsed().as_secs_f64();
        if !request.quiet {
            prepared.print_notes(&request);
        }
        let runs = search::all(&request, &prepared, pooled.as_mut())?;
        let Some(pooled) = &mut pooled else { break (prepared, runs, doses_s) };
        pooled.print_news();
        if !pooled.is_in_doubt(&request.doses, request.setup.engines())? {
            if !request.quiet {
                pooled.print_notes(&runs.0);
            }
            break (prepared, runs, doses_s);
        }
        errln!("pool: the plan is made again without the answers of workers that were shut out");
    };
    let (Some(best), chosen_s) = (best(&runs.0), began.elapsed().as_secs_f64() - doses_s) else {
        return Err(Failure::failed("no method was run"));
    };
    let outcome = Outcome::new(&request, &prepared, best)?;
    let files = folder::write(&request, &prepared, &runs.0, &outcome)?;
    let is_refused = outcome.is_refused(&request);
    report(Made {
        request: &request,
        prepared: &prepared,
        runs: &runs,
        outcome: &outcome,
        files,
        doses_s,
        chosen_s,
        all_s: began.elapsed().as_secs_f64(),
    })?;
    Ok(if is_refused { Exit::Refused } else { Exit::Done })
}

/// The run with the least cost, the first among equals.
fn best(runs: &[PlanRun]) -> Option<&PlanRun> {
    runs.iter().reduce(|a, b| if b.choice.best.cost < a.choice.best.cost { b } else { a })
}
