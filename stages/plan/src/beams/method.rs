//! The classical methods of choosing beams. Each spends a budget of solves and does not depend on time.

use std::sync::Arc;

use thiserror::Error;

use super::evaluator::{Evaluated, Evaluator, Influence, Stop};
use super::ring::{BeamSet, Ring, RingError};
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
    /// From the greedy set, one beam exchanged for another as long as that is better; the exchanges of the highest
    /// price first.
    Exchange,
    /// From the greedy set, random exchanges, worse ones too while it is hot.
    Annealing,
    /// Beams are added by price beyond the number wanted, then those that carry least are taken away, again and again.
    ColumnGeneration,
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

/// Chooses beams by `method` until it ends or the evaluator's budget is spent. `seed` is used by those that draw.
pub fn choose<I: Influence + ?Sized>(
    method: &Method,
    evaluator: &mut Evaluator<'_, I>,
    seed: u64,
) -> Result<Choice, ChoiceError> {
    evaluator.ring().check_room(evaluator.beams())?;
    let ended = match method {
        Method::Equidistant => equidistant(evaluator),
        Method::Class(angles) => class(evaluator, angles),
        Method::Random => random::search(evaluator, seed).map_err(Into::into),
        Method::Greedy => greedy::search(evaluator).map(|_| ()).map_err(Into::into),
        Method::Exchange => exchange::search(evaluator).map_err(Into::into),
        Method::Annealing => annealing::search(evaluator, seed).map_err(Into::into),
        Method::ColumnGeneration => columns::search(evaluator).map_err(Into::into),
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

fn class<I: Influence + ?Sized>(evaluator: &mut Evaluator<'_, I>, angles: &[f64]) -> Result<(), ChoiceError> {
    let (found, expected) = (angles.len(), evaluator.beams());
    if found != expected {
        return Err(ChoiceError::Count { found, expected });
    }
    let ring = evaluator.ring();
    let set = ring.set(&angles.iter().map(|angle| ring.nearest(*angle)).collect::<Vec<_>>())?;
    evaluator.evaluate(&set, None)?;
    Ok(())
}
