//! The plan of one patient: from the request to the files.

use std::path::PathBuf;
use std::time::Instant;

use stillpoint_plan::dose::{DoseCache, EngineName};
use stillpoint_plan::plan_file::{PlanFileCouch, PlanFileHigher};
use stillpoint_plan::recipe::{Higher, PlanRun};

use super::args::PlanArgs;
use super::folder;
use super::outcome::Outcome;
use super::pooled::Pooled;
use super::prepared::Prepared;
use super::request::{Patient, Request};
use super::search;
use crate::exit::{Ended, Exit, Failure};
use crate::out_folder::OutFolder;

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
    let mut request = Request::new(args, patient)?;
    let out = OutFolder::ready(&request.out)?;
    let began = Instant::now();
    let record = args.pool_record.as_deref();
    let mut pooled = args.pool.open()?.map(|pool| Pooled::new(pool, &request.doses, record)).transpose()?;
    let Searched { request, prepared, runs, best, doses_s } = loop {
        let searched = searched(request, patient.weights.as_deref(), pooled.as_mut())?;
        let Some(pooled) = &mut pooled else { break searched };
        pooled.print_news();
        if !pooled.is_in_doubt() {
            pooled.adopt_doses()?;
            if !searched.request.quiet {
                pooled.print_notes(&searched.runs.0);
            }
            break searched;
        }
        errln!("pool: the plan is made again without the answers of workers that were shut out");
        request = Request::new(args, patient)?;
    };
    let chosen_s = began.elapsed().as_secs_f64() - doses_s;
    if let Some(pooled) = &mut pooled {
        pooled.write_record()?;
    }
    let outcome = Outcome::new(&request, &prepared, &best)?;
    let files = folder::write(&out, &request, &prepared, &runs.0, &outcome)?;
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

/// Beams that were searched, and their plan.
struct Searched {
    /// The request, with doses by the method of the plan.
    request: Request,
    /// What the plan is made on.
    prepared: Prepared,
    /// The searches.
    runs: search::Runs,
    /// The best of them, with the fluence of the plan.
    best: PlanRun,
    /// Seconds that the doses took.
    doses_s: f64,
}

/// Searches, or takes given weights, and solves the fluence of the beams that were found again where the plan is by another method.
fn searched(
    request: Request,
    weights: Option<&[f64]>,
    mut pooled: Option<&mut Pooled>,
) -> Result<Searched, Failure> {
    request.check_leaves()?;
    let begun = Instant::now();
    let prepared = Prepared::new(&request, pooled.as_deref_mut())?;
    let mut doses_s = begun.elapsed().as_secs_f64();
    if !request.quiet {
        prepared.print_notes(&request);
    }
    let runs = match (weights, &request.start, &request.searches[..]) {
        (Some(weights), _, [search, ..]) => {
            let given = search.of_weights(&request.setup, &prepared.doses, weights);
            (vec![given.map_err(Failure::wrong)?], vec![0.0])
        }
        (None, Some(start), [search, ..]) => {
            let begun = Instant::now();
            let found = search.starting_from(&request.setup, &prepared.doses, &start.fluence());
            (vec![found.map_err(Failure::wrong)?], vec![begun.elapsed().as_secs_f64()])
        }
        _ => search::all(&request, &prepared, pooled.as_deref_mut())?,
    };
    let Some(best) = best(&runs.0).cloned() else { return Err(Failure::failed("no method was run")) };
    if request.couch_deg > 0.0 && weights.is_none() {
        return with_couch(request, prepared, runs, best, doses_s, pooled);
    }
    let engine = request.setup.engine_of_plan(best.choice.best.beams.beams()).map_err(Failure::failed)?;
    if engine == request.setup.engine_name() {
        let (prepared, best) = settled(&request, prepared, best)?;
        return Ok(Searched { request, prepared, runs, best, doses_s });
    }
    drop(prepared);
    print_engine(&request, engine);
    let request = request.by(engine, &best)?;
    request.check_leaves()?;
    let begun = Instant::now();
    let prepared = Prepared::new(&request, pooled.as_deref_mut())?;
    doses_s += begun.elapsed().as_secs_f64();
    let (solved, _) = search::all(&request, &prepared, pooled)?;
    let Some(solved) = solved.into_iter().next() else { return Err(Failure::failed("no method was run")) };
    let (prepared, solved) = settled(&request, prepared, solved)?;
    Ok(Searched { request, prepared, runs, best: PlanRun { choice: solved.choice, ..best }, doses_s })
}

/// Goes on with couch angles from the best beams without them, and solves the fluence of those that were found.
fn with_couch(
    request: Request,
    prepared: Prepared,
    runs: search::Runs,
    best: PlanRun,
    doses_s: f64,
    pooled: Option<&mut Pooled>,
) -> Result<Searched, Failure> {
    let (mut runs, mut doses_s) = (runs, doses_s);
    let Some(search) = request.searches.iter().find(|search| search.name == best.name) else {
        return Err(Failure::failed("no method was run"));
    };
    let begun = Instant::now();
    let cache = DoseCache::in_folder(&request.doses).map_err(Failure::failed)?;
    let found =
        search.with_couch(&request.setup, &cache, &best, request.couch_deg).map_err(Failure::failed)?;
    drop(prepared);
    let angles = found.run.directions.all(found.run.choice.best.beams.beams());
    let higher = |higher: &Higher| PlanFileHigher {
        structure: higher.structure.clone(),
        coplanar_gy: higher.coplanar_gy,
        mean_gy: higher.mean_gy,
    };
    let couch = PlanFileCouch {
        most_deg: request.couch_deg,
        coplanar_objective: best.choice.best.cost,
        coplanar_angles_deg: request.setup.angles_deg(best.choice.best.beams.beams()),
        objective: found.run.choice.best.cost,
        candidates: found.candidates,
        doses: found.doses,
        higher: found.higher.iter().map(higher).collect(),
    };
    let engine = request.setup.engine_of_angles(&angles).map_err(Failure::failed)?;
    if engine != request.setup.engine_name() {
        print_engine(&request, engine);
    }
    let request = request.with_couch(engine, &angles, couch)?;
    request.check_leaves()?;
    runs.0.push(found.run.clone());
    runs.1.push(begun.elapsed().as_secs_f64());
    let begun = Instant::now();
    let mut pooled = pooled;
    let prepared = Prepared::new(&request, pooled.as_deref_mut())?;
    doses_s += begun.elapsed().as_secs_f64();
    let (solved, _) = search::all(&request, &prepared, pooled)?;
    let Some(solved) = solved.into_iter().next() else { return Err(Failure::failed("no method was run")) };
    let (prepared, solved) = settled(&request, prepared, solved)?;
    let best = PlanRun { choice: solved.choice, ..found.run };
    Ok(Searched { request, prepared, runs, best, doses_s })
}

/// Says that the plan is by another method than the search.
fn print_engine(request: &Request, engine: EngineName) {
    if !request.quiet {
        outln!(
            "the beams that were found cross lung or air, or are those of a head or neck: their plan is by {engine}"
        );
    }
}

/// The best run on columns that are corrected for it, which matters where dose is by superposition.
fn settled(request: &Request, prepared: Prepared, best: PlanRun) -> Result<(Prepared, PlanRun), Failure> {
    let Some(search) = request.searches.iter().find(|search| search.name == best.name) else {
        return Ok((prepared, best));
    };
    let Prepared { doses, .. } = prepared;
    let (doses, best) = match request.has_weights {
        true => search.settle_weights(&request.setup, doses, best).map_err(Failure::wrong)?,
        false => search.settle(&request.setup, doses, best).map_err(Failure::failed)?,
    };
    Ok((Prepared { doses, ..prepared }, best))
}

/// The run with the least cost, the first among equals.
fn best(runs: &[PlanRun]) -> Option<&PlanRun> {
    runs.iter().reduce(|a, b| if b.choice.best.cost < a.choice.best.cost { b } else { a })
}
