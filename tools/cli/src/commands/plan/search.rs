//! The methods of choosing beams, each with its progress.

use std::time::Instant;

use stillpoint_plan::beams::{Budget, Choice, Evaluator, Progress, Solver, choose};
use stillpoint_pool::{PoolGround, PoolSolver};

use super::ground::{Ground, bar};
use super::pooled::Pooled;
use super::request::Request;
use super::way::Way;
use crate::exit::Failure;

/// A search that has ended.
pub struct Run {
    /// How beams were chosen.
    pub way: Way,
    /// The best set of beams.
    pub choice: Choice,
    /// Every solve.
    pub history: Vec<Progress>,
    /// Beams priced.
    pub prices: usize,
    /// How long it took.
    pub seconds: f64,
}

/// Runs every requested method, each with the whole budget, on the pool if there is one.
pub fn all(request: &Request, ground: &Ground, pooled: Option<&mut Pooled>) -> Result<Vec<Run>, Failure> {
    let mut methods = request.methods.iter();
    let Some(pooled) = pooled else {
        return methods.map(|(way, method)| run(request, ground, *way, method, None)).collect();
    };
    let named = PoolGround::new(&ground.doses, &ground.goals, request.ring.count());
    let mut solver = PoolSolver::new(&mut pooled.pool, &named);
    let runs: Result<Vec<Run>, Failure> = methods.try_fold(Vec::new(), |mut runs, (way, method)| {
        runs.push(run(request, ground, *way, method, Some(&mut solver))?);
        Ok(runs)
    });
    if let Some(reason) = solver.broken() {
        errln!("pool: this process went on alone: {reason}");
    }
    runs
}

fn run(
    request: &Request,
    ground: &Ground,
    way: Way,
    method: &stillpoint_plan::beams::Method,
    solver: Option<&mut dyn Solver>,
) -> Result<Run, Failure> {
    let began = Instant::now();
    let bar = bar(request.budget as u64, way.word(), request.quiet);
    let budget = Budget { solves: request.budget };
    let evaluator = Evaluator::new(&ground.doses, &ground.goals, request.ring, request.beams, budget);
    let second = ground.second_player();
    let evaluator = match &second {
        Some(second) => evaluator.against(second),
        None => evaluator,
    };
    let evaluator = match solver {
        Some(solver) => evaluator.with_solver(solver),
        None => evaluator,
    };
    let mut evaluator = evaluator.with_threads(request.threads).with_progress(|progress| {
        bar.set_position(progress.solves as u64);
        if progress.best.is_finite() {
            bar.set_message(format!("best {:.2}", progress.best));
        }
    });
    let choice = choose(method, &mut evaluator, request.prior(), request.seed);
    bar.finish_and_clear();
    let choice = choice.map_err(|e| Failure::failed(format!("{}: {e}", way.word())))?;
    let (history, prices) = (evaluator.history().to_vec(), evaluator.prices());
    Ok(Run { way, choice, history, prices, seconds: began.elapsed().as_secs_f64() })
}
