//! Methods of choosing beams at the same number of solves, on the same patients.

use rustix::time::{ClockId, clock_gettime};
use stillpoint_network::game::APART;
use stillpoint_plan::beams::{
    BeamGame, BeamSet, Budget, Evaluator, Geometry, Method, Prior, RingError, SearchOptions, choose,
};

use super::subject::Subject;

/// A method with its name.
pub struct Entry {
    /// Its name in tables.
    pub name: &'static str,
    contender: Contender,
    /// Whether the seed changes what it does within few solves, so that several are run.
    pub drawn: bool,
    /// Whether the budget changes what it does before the budget is spent, so that each budget needs a run.
    planned: bool,
    /// Whether it is run only where all methods are wanted.
    pub seldom: bool,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Contender {
    Exchange,
    ExchangeFromNetwork,
    Search,
    SearchWithGeometry,
    SearchWithNetwork,
    Network,
    NetworkAlone,
    Annealing,
    Random,
    Class,
    Rotations,
    Greedy,
    Columns,
    GeometryAlone,
    Construction,
    TwoPlayers,
}

/// The methods that are compared. `exchange` and `search` begin with the class set where the site has one.
pub const ENTRIES: [Entry; 16] = [
    Entry::of("exchange", Contender::Exchange, true),
    Entry::of("exchange from the network's sets", Contender::ExchangeFromNetwork, true),
    Entry::of("search", Contender::Search, true),
    Entry::of("search with the network", Contender::SearchWithNetwork, true),
    Entry::of("network's sets", Contender::Network, false),
    Entry { seldom: true, ..Entry::of("network's policy alone", Contender::NetworkAlone, false) },
    Entry::of("class set", Contender::Class, false),
    Entry::of("best rotation", Contender::Rotations, false),
    Entry { planned: true, ..Entry::of("annealing", Contender::Annealing, true) },
    Entry::of("random", Contender::Random, true),
    Entry { seldom: true, ..Entry::of("search, price and geometry", Contender::SearchWithGeometry, true) },
    Entry { seldom: true, ..Entry::of("greedy", Contender::Greedy, false) },
    Entry { seldom: true, ..Entry::of("column generation", Contender::Columns, false) },
    Entry { seldom: true, ..Entry::of("geometry alone", Contender::GeometryAlone, false) },
    Entry { seldom: true, ..Entry::of("game, beam by beam", Contender::Construction, false) },
    Entry { seldom: true, ..Entry::of("game, two players", Contender::TwoPlayers, false) },
];

impl Entry {
    const fn of(name: &'static str, contender: Contender, drawn: bool) -> Self {
        Self { name, contender, drawn, planned: false, seldom: false }
    }

    /// The method for a patient; none where it has no class set.
    fn method(&self, subject: &Subject, beams: usize, solves: usize) -> Result<Option<Method>, RingError> {
        let ring = subject.ring;
        let proposed = || -> Result<Vec<Vec<f64>>, RingError> {
            let sets = subject.judgement.spread_sets(ring, beams, solves, APART)?;
            let degrees = |set: &BeamSet| set.beams().iter().map(|beam| ring.angle_deg(*beam)).collect();
            Ok(sets.iter().map(degrees).collect())
        };
        let first = || proposed().map(|sets| sets.into_iter().take(1).collect::<Vec<_>>());
        let search = SearchOptions { starts: subject.class.clone(), ..SearchOptions::default() };
        Ok(Some(match self.contender {
            Contender::Exchange => Method::Exchange(subject.class.clone()),
            Contender::ExchangeFromNetwork => Method::Exchange(first()?),
            Contender::Search => Method::Search(search),
            Contender::SearchWithGeometry => Method::Search(SearchOptions { prior: 0.5, ..search }),
            Contender::SearchWithNetwork => {
                Method::Search(SearchOptions { starts: first()?, prior: 0.5, ..search })
            }
            Contender::Network => Method::Sets(subject.judgement.spread_sets(ring, beams, solves, APART)?),
            Contender::NetworkAlone | Contender::GeometryAlone => Method::Prior,
            Contender::Annealing => Method::Annealing,
            Contender::Random => Method::Random,
            Contender::Class => match subject.class.first() {
                Some(class) => Method::Class(class.clone()),
                None => return Ok(None),
            },
            Contender::Rotations => Method::Equidistant,
            Contender::Greedy => Method::Greedy,
            Contender::Columns => Method::ColumnGeneration,
            Contender::Construction => Method::Game(BeamGame::Construction),
            Contender::TwoPlayers => Method::Game(BeamGame::Alternating { depth: 2 }),
        }))
    }
}

/// One run: the least cost after each of the wanted numbers of solves, and CPU-seconds.
pub struct Ran {
    /// Infinite where no set was solved yet.
    pub best: Vec<f64>,
    /// Of the whole run, of the largest number of solves.
    pub cpu_s: f64,
}

/// Runs a method on a patient; none where the patient has no class set to run.
pub fn run(
    subject: &Subject,
    entry: &Entry,
    beams: usize,
    at: &[usize],
    seed: u64,
) -> Result<Option<Ran>, Box<dyn std::error::Error>> {
    let geometry = Geometry::of_case(subject.problem.case(), subject.ring);
    let prior: Option<&dyn Prior> = match entry.contender {
        Contender::SearchWithGeometry
        | Contender::GeometryAlone
        | Contender::Construction
        | Contender::TwoPlayers => Some(&geometry),
        Contender::SearchWithNetwork | Contender::NetworkAlone => Some(&subject.judgement),
        _ => None,
    };
    let largest = at.iter().copied().max().unwrap_or(1);
    let Some(method) = entry.method(subject, beams, largest)? else { return Ok(None) };
    let once = |solves: usize| -> Result<(Vec<f64>, f64), Box<dyn std::error::Error>> {
        let began = cpu_seconds();
        let goals = subject.problem.goals();
        let mut evaluator = Evaluator::new(&subject.doses[..], goals, subject.ring, beams, Budget { solves });
        // Fewer solves than a plan needs leave no best set, which is infinite here.
        let chosen = choose(&method, &mut evaluator, prior, seed);
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
    let (history, cpu_s) = once(largest)?;
    let mut best = Vec::new();
    for solves in at {
        best.push(match entry.planned && *solves != largest {
            true => after(&once(*solves)?.0, *solves),
            false => after(&history, *solves),
        });
    }
    Ok(Some(Ran { best, cpu_s }))
}

/// CPU-seconds of this thread.
pub fn cpu_seconds() -> f64 {
    let now = clock_gettime(ClockId::ThreadCPUTime);
    now.tv_sec as f64 + 1e-9 * now.tv_nsec as f64
}
