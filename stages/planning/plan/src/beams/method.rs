//! The classical methods of choosing beams. Each spends a budget of solves and does not depend on time.

use std::sync::Arc;

use thiserror::Error;

use super::evaluator::{Evaluated, Evaluator, Influence, Stop};
use super::prior::{Prior, PriorError, Uniform, set_of_prior};
use super::ring::{BeamSet, Ring, RingError};
use super::search::{self, BeamGame, SearchOptions};
use super::{annealing, columns, exchange, greedy, random};

/// A way to choose beams.
#[derive(Clone, Debug, PartialEq)]
pub enum Method {
    /// Equally spaced beams, in every rotation.
    Equidistant,
    /// Given angles, degrees: what is used for such patients. [`class_solution`] has some.
    Class(Vec<f64>),
    /// The best of sets drawn uniformly.
    Random,
    /// One beam after the other, the one of the highest price beside those chosen.
    Greedy,
    /// From the best of these sets of angles (degrees), one beam exchanged for another as long as that is better, priced
    /// beside the beams that stay; then from random sets. Without angles it begins with rotations of equal beams.
    /// [`pelvis_solutions`] has some.
    Exchange(Vec<Vec<f64>>),
    /// From the greedy set, random exchanges, worse ones too while it is hot.
    Annealing,
    /// Beams are added by price beyond the number wanted, then those that carry least are taken away, again and again.
    ColumnGeneration,
    /// Tree search over exchanges; see [`SearchOptions`]. It uses the prior.
    Search(SearchOptions),
    /// A game of the dissertation, searched by its algorithm 1. It uses the prior.
    Game(BeamGame),
    /// The set that the prior builds by itself, and no other: one solve.
    Prior,
    /// These sets of beams, in their order, as far as the budget goes.
    Sets(Vec<BeamSet>),
}

/// What a method found.
#[derive(Clone, Debug)]
pub struct Choice {
    /// The best set and its fluence.
    pub best: Arc<Evaluated>,
    /// Whether the budget ended the search; otherwise there was nothing left to try.
    pub spent: bool,
}

/// The reasons why a method found no set.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum ChoiceError {
    /// So many beams do not fit, or given ones do not.
    #[error(transparent)]
    Ring(#[from] RingError),
    /// A problem could not be made.
    #[error(transparent)]
    Stop(Stop),
    /// The prior gives no set.
    #[error(transparent)]
    Prior(#[from] PriorError),
    /// No set of that many beams was solved.
    #[error("{solves} solves are too few for a plan of {beams} beams by this method; allow at least {beams}")]
    TooFew {
        /// Solves made.
        solves: usize,
        /// Beams of a plan.
        beams: usize,
    },
    /// A class solution of another number of beams.
    #[error("the class solution has {found} beams, the plan {expected}")]
    Count {
        /// Its beams.
        found: usize,
        /// Beams of a plan.
        expected: usize,
    },
}

impl From<Stop> for ChoiceError {
    fn from(stop: Stop) -> Self {
        Self::Stop(stop)
    }
}

/// Angles in common use for the pelvis, degrees; equally spaced ones from 0 where there is no such habit.
pub fn class_solution(beams: usize) -> Vec<f64> {
    match beams {
        5 => vec![36.0, 100.0, 180.0, 260.0, 324.0],
        7 => vec![0.0, 52.0, 100.0, 152.0, 208.0, 260.0, 308.0],
        _ => (0..beams).map(|i| 360.0 * i as f64 / beams as f64).collect(),
    }
}

/// Sets of angles to begin a search for a pelvis with, degrees; none where there is no such habit. The first set of five
/// was the best of a search over synthetic pelves.
pub fn pelvis_solutions(beams: usize) -> Vec<Vec<f64>> {
    match beams {
        5 => vec![vec![44.0, 92.0, 120.0, 252.0, 336.0], class_solution(5)],
        7 => vec![class_solution(7)],
        _ => Vec::new(),
    }
}

/// Chooses beams by `method` until it ends or the evaluator's budget is spent. `prior` is used by the methods that say so,
/// [`Uniform`] where there is none, and `seed` by those that draw.
pub fn choose<I: Influence + ?Sized>(
    method: &Method,
    evaluator: &mut Evaluator<'_, I>,
    prior: Option<&dyn Prior>,
    seed: u64,
) -> Result<Choice, ChoiceError> {
    evaluator.ring().check_room(evaluator.beams())?;
    let ended = match method {
        Method::Equidistant => equidistant(evaluator),
        Method::Class(angles) => class(evaluator, angles),
        Method::Random => random::search(evaluator, seed).map_err(Into::into),
        Method::Greedy => greedy::search(evaluator).map(|_| ()).map_err(Into::into),
        Method::Exchange(starts) => exchange(evaluator, starts, seed),
        Method::Annealing => annealing::search(evaluator, seed).map_err(Into::into),
        Method::ColumnGeneration => columns::search(evaluator).map_err(Into::into),
        Method::Search(options) => tree_search(evaluator, options, prior, seed),
        Method::Game(game) => search::play(evaluator, *game, prior),
        Method::Prior => by_prior(evaluator, prior.unwrap_or(&Uniform)),
        Method::Sets(sets) => given(evaluator, sets),
    };
    let spent = match ended {
        Ok(()) => false,
        Err(ChoiceError::Stop(Stop::Spent)) => true,
        Err(other) => return Err(other),
    };
    let few = ChoiceError::TooFew { solves: evaluator.solves(), beams: evaluator.beams() };
    Ok(Choice { best: evaluator.best().cloned().ok_or(few)?, spent })
}

/// All rotations of beams as equal as the ring allows.
pub fn rotations(ring: Ring, beams: usize) -> Result<Vec<BeamSet>, RingError> {
    ring.check_room(beams)?;
    let count = usize::from(ring.count());
    let turns = count.div_ceil(beams);
    let place = |turn: usize, i: usize| ((turn + (i * count + beams / 2) / beams) % count) as u16;
    (0..turns).map(|turn| ring.set(&(0..beams).map(|i| place(turn, i)).collect::<Vec<_>>())).collect()
}

fn equidistant<I: Influence + ?Sized>(evaluator: &mut Evaluator<'_, I>) -> Result<(), ChoiceError> {
    let sets = rotations(evaluator.ring(), evaluator.beams())?;
    let solved = evaluator.evaluate_all(&sets, None)?;
    if solved.len() < sets.len() { Err(Stop::Spent.into()) } else { Ok(()) }
}

fn exchange<I: Influence + ?Sized>(
    evaluator: &mut Evaluator<'_, I>,
    starts: &[Vec<f64>],
    seed: u64,
) -> Result<(), ChoiceError> {
    let (ring, beams) = (evaluator.ring(), evaluator.beams());
    let starts: Result<Vec<BeamSet>, _> =
        starts.iter().map(|angles| nearest_set(ring, beams, angles)).collect();
    Ok(exchange::search(evaluator, &starts?, seed)?)
}

/// The set of the angles of the ring nearest to these.
fn nearest_set(ring: Ring, beams: usize, angles: &[f64]) -> Result<BeamSet, ChoiceError> {
    if angles.len() != beams {
        return Err(ChoiceError::Count { found: angles.len(), expected: beams });
    }
    Ok(ring.set(&angles.iter().map(|angle| ring.nearest(*angle)).collect::<Vec<_>>())?)
}

fn class<I: Influence + ?Sized>(evaluator: &mut Evaluator<'_, I>, angles: &[f64]) -> Result<(), ChoiceError> {
    let set = nearest_set(evaluator.ring(), evaluator.beams(), angles)?;
    evaluator.evaluate(&set, None)?;
    Ok(())
}

fn given<I: Influence + ?Sized>(
    evaluator: &mut Evaluator<'_, I>,
    sets: &[BeamSet],
) -> Result<(), ChoiceError> {
    let expected = evaluator.beams();
    if let Some(found) = sets.iter().map(|set| set.beams().len()).find(|found| *found != expected) {
        return Err(ChoiceError::Count { found, expected });
    }
    let solved = evaluator.evaluate_all(sets, None)?;
    if solved.len() < sets.len() { Err(Stop::Spent.into()) } else { Ok(()) }
}

fn tree_search<I: Influence + ?Sized>(
    evaluator: &mut Evaluator<'_, I>,
    options: &SearchOptions,
    prior: Option<&dyn Prior>,
    seed: u64,
) -> Result<(), ChoiceError> {
    let (ring, beams) = (evaluator.ring(), evaluator.beams());
    let starts: Result<Vec<BeamSet>, _> =
        options.starts.iter().map(|angles| nearest_set(ring, beams, angles)).collect();
    search::search(evaluator, options, &starts?, prior, seed)
}

fn by_prior<I: Influence + ?Sized>(
    evaluator: &mut Evaluator<'_, I>,
    prior: &dyn Prior,
) -> Result<(), ChoiceError> {
    let set = set_of_prior(prior, evaluator.ring(), evaluator.beams())?;
    evaluator.evaluate(&set, None)?;
    Ok(())
}
