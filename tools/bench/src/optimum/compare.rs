//! Methods of choosing beams at the same number of solves, on the same pelves.

use rustix::time::{ClockId, clock_gettime};
use stillpoint_plan::beams::{
    BeamGame, Budget, Evaluator, Geometry, Method, Prior, SearchOptions, choose, pelvis_solutions,
};

use super::pelvis::Pelvis;

/// A method with its name.
pub struct Entry {
    /// Its name in tables.
    pub name: &'static str,
    /// The method.
    pub method: Method,
    /// Its prior.
    pub prior: Guide,
    /// Whether the seed changes what it does within few solves, so that several are run.
    pub drawn: bool,
    /// Whether the budget changes what it does before the budget is spent, so that each budget needs a run.
    pub planned: bool,
}

/// A prior by its name.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Guide {
    /// None.
    None,
    /// From the image.
    Geometry,
}

/// The methods that are compared. Those that take sets to begin with begin with the one class set.
pub fn entries() -> Vec<Entry> {
    let starts: Vec<Vec<f64>> = pelvis_solutions(5).into_iter().take(1).collect();
    let search = SearchOptions { starts: starts.clone(), ..SearchOptions::default() };
    let geometry = SearchOptions { prior: 0.5, ..search.clone() };
    let of = |name, method, prior, drawn, planned| Entry { name, method, prior, drawn, planned };
    vec![
        of("exchange", Method::Exchange(starts.clone()), Guide::None, true, false),
        of("search", Method::Search(search), Guide::None, true, false),
        of("search, price and geometry", Method::Search(geometry), Guide::Geometry, true, false),
        of("annealing", Method::Annealing, Guide::None, true, true),
        of("random", Method::Random, Guide::None, true, false),
        of(
            "class set",
            Method::Class(starts.into_iter().next().unwrap_or_default()),
            Guide::None,
            false,
            false,
        ),
        of("best rotation", Method::Equidistant, Guide::None, false, false),
        of("greedy", Method::Greedy, Guide::None, false, false),
        of("column generation", Method::ColumnGeneration, Guide::None, false, false),
        of("geometry alone", Method::Prior, Guide::Geometry, false, false),
        of("game, beam by beam", Method::Game(BeamGame::Construction), Guide::Geometry, false, false),
        of(
            "game, two players",
            Method::Game(BeamGame::Alternating { depth: 2 }),
            Guide::Geometry,
            false,
            false,
        ),
    ]
}

/// One run: the least cost after each of the wanted numbers of solves, and CPU-seconds.
pub struct Ran {
    /// Infinite where no set was solved yet.
    pub best: Vec<f64>,
    /// Of the whole run, of the largest number of solves.
    pub cpu_s: f64,
}

/// Runs a method on a pelvis.
pub fn run(
    pelvis: &Pelvis,
    entry: &Entry,
    beams: usize,
    at: &[usize],
    seed: u64,
) -> Result<Ran, Box<dyn std::error::Error>> {
    let geometry = Geometry::of_case(&pelvis.case, pelvis.ring);
    let prior: Option<&dyn Prior> = match entry.prior {
        Guide::None => None,
        Guide::Geometry => Some(&geometry),
    };
    let once = |solves: usize| -> Result<(Vec<f64>, f64), Box<dyn std::error::Error>> {
        let began = cpu_seconds();
        let mut evaluator =
            Evaluator::new(&pelvis.doses[..], &pelvis.goals, pelvis.ring, beams, Budget { solves });
        // Fewer solves than a plan needs leave no best set, which is infinite here.
        let chosen = choose(&entry.method, &mut evaluator, prior, seed);
        if let Err(why) = chosen
            && (evaluator.best().is_some() || evaluator.solves() < solves.min(beams))
        {
            return Err(why.into());
        }
        let best: Vec<f64> = evaluator.history().iter().map(|progress| progress.best).collect();
        Ok((best, cpu_seconds() - began))
    };
    let after = |history: &[f64], solves: usize| {
        history
            .get(..solves.min(history.len()))
            .and_then(|part| part.last().copied())
            .unwrap_or(f64::INFINITY)
    };
    let largest = at.iter().copied().max().unwrap_or(1);
    let (history, cpu_s) = once(largest)?;
    let mut best = Vec::new();
    for solves in at {
        best.push(match entry.planned && *solves != largest {
            true => after(&once(*solves)?.0, *solves),
            false => after(&history, *solves),
        });
    }
    Ok(Ran { best, cpu_s })
}

fn cpu_seconds() -> f64 {
    let now = clock_gettime(ClockId::ThreadCPUTime);
    now.tv_sec as f64 + 1e-9 * now.tv_nsec as f64
}
