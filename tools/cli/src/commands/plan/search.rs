//! The searches of a request, each with its progress.

use std::time::Instant;

use stillpoint_plan::beams::Solver;
use stillpoint_plan::recipe::{PlanRun, PlanSearch};
use stillpoint_pool::{PoolSetup, PoolSolver};

use super::pooled::Pooled;
use super::prepared::{Prepared, bar};
use super::request::Request;
use crate::exit::Failure;

/// Searches that have ended, with the seconds that each took.
pub type Runs = (Vec<PlanRun>, Vec<f64>);

/// Runs every search, each with the whole budget, on the pool if there is one.
pub fn all(request: &Request, prepared: &Prepared, pooled: Option<&mut Pooled>) -> Result<Runs, Failure> {
    let Some(pooled) = pooled else {
        let runs: Result<Vec<_>, Failure> =
            request.searches.iter().map(|search| run(request, prepared, search, None)).collect();
        return Ok(runs?.into_iter().unzip());
    };
    let setup = &request.setup;
    let beams = setup.directions.ring().count();
    let named = PoolSetup::new(&prepared.doses.solved, &setup.goals, beams, request.threads);
    let mut solver = PoolSolver::new(&mut pooled.pool, &named);
    let mut runs = Runs::default();
    for search in &request.searches {
        let (run, seconds) = run(request, prepared, search, Some(&mut solver))?;
        runs.0.push(run);
        runs.1.push(seconds);
    }
    if let Some(reason) = solver.broken() {
        errln!("pool: this process went on alone: {reason}");
    }
    Ok(runs)
}

fn run(
    request: &Request,
    prepared: &Prepared,
    search: &PlanSearch,
    solver: Option<&mut dyn Solver>,
) -> Result<(PlanRun, f64), Failure> {
    let began = Instant::now();
    let bar = bar(search.budget as u64, search.name.word(), request.quiet);
    let second = prepared.doses.second_player(&request.setup);
    let evaluator = search.evaluator(&request.setup, &prepared.doses, second.as_ref());
    let evaluator = match solver {
        Some(solver) => evaluator.with_solver(solver),
        None => evaluator,
    };
    let evaluator = evaluator.with_progress(|progress| {
        bar.set_position(progress.solves as u64);
        if progress.best.is_finite() {
            bar.set_message(format!("best {:.2}", progress.best));
        }
    });
    let found = search.run(evaluator);
    bar.finish_and_clear();
    let found = found.map_err(|e| Failure::failed(format!("{}: {e}", search.name)))?;
    Ok((found, began.elapsed().as_secs_f64()))
}
