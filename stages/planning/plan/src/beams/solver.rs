//! Where sets are solved and beams are priced: on threads of this process, unless another [`Solver`] is given.

use std::num::NonZeroUsize;

use thiserror::Error;

use super::evaluator::{Evaluated, Influence, Stop};
use super::price::{Slopes, promise};
use super::ring::BeamSet;
use crate::Setups;
use crate::fluence::{Goals, GoalsError, Options, Plan, solve_plan};
use crate::threads::on_threads;

/// Accuracy of the solve of a set, unless another is asked for: a thousandth of what counts as a solve.
pub const SOLVE_TOLERANCE: f64 = 1e-6;

/// Coarsest accuracy that counts as a solve.
pub const COARSEST_TOLERANCE: f64 = 1e-3;

/// A tolerance that no solve can have.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[error(
    "a tolerance of {0} is not above 0 and at most {COARSEST_TOLERANCE}, the coarsest that counts as a solve"
)]
pub struct ToleranceError(pub f64);

/// The tolerance, if it can be that of a solve.
///
/// # Errors
/// It is not above 0 and at most [`COARSEST_TOLERANCE`].
pub fn checked_tolerance(tolerance: f64) -> Result<f64, ToleranceError> {
    if tolerance > 0.0 && tolerance <= COARSEST_TOLERANCE {
        Ok(tolerance)
    } else {
        Err(ToleranceError(tolerance))
    }
}

/// A set with the neighbouring set from whose fluence its solve begins.
pub type Begun<'a> = (&'a BeamSet, Option<&'a Evaluated>);

/// Solves sets and prices beams for an [`super::Evaluator`].
///
/// The results are pure functions of goals, dose matrices and arguments: every solver gives the same bits as [`Local`].
pub trait Solver {
    /// The best fluence of each set to this part of its optimum, in the order of the sets, found from that of a neighbouring
    /// set where one is given.
    ///
    /// # Errors
    /// The goals and matrices make no problem, or the answers are not there yet: [`Stop::Waiting`].
    fn solve(
        &mut self,
        sets: &[&BeamSet],
        near: Option<&Evaluated>,
        tolerance: f64,
    ) -> Result<Vec<Evaluated>, Stop>;

    /// Says that these sets will be asked for with the same arguments, so that a solver with free workers can begin.
    ///
    /// # Errors
    /// As for [`Solver::solve`].
    fn begin(&mut self, _sets: &[&BeamSet], _near: Option<&Evaluated>, _tolerance: f64) -> Result<(), Stop> {
        Ok(())
    }

    /// Says that these candidates will be priced beside a set that was begun, so that a solver with free workers can price
    /// them as soon as the set is solved. Prices that nobody asks for change nothing.
    fn expect_prices(&mut self, _set: &BeamSet, _candidates: &[u16]) {}

    /// The price of each candidate beside a solved set, or beside no beam.
    ///
    /// # Errors
    /// As for [`Solver::solve`].
    fn price(&mut self, base: Option<&Evaluated>, candidates: &[u16]) -> Result<Vec<f64>, Stop>;
}

/// The threads of this process.
#[derive(Clone, Copy)]
pub struct Local<'a, I: Influence + ?Sized> {
    /// The dose matrices.
    pub influence: &'a I,
    /// What is wanted.
    pub goals: &'a Goals,
    /// The most threads.
    pub threads: NonZeroUsize,
}

impl<I: Influence + ?Sized> Local<'_, I> {
    /// The best fluence of each set to this part of its optimum, in the order of the sets.
    ///
    /// # Errors
    /// The goals and matrices make no problem.
    pub fn solve_begun(&self, begun: &[Begun<'_>], tolerance: f64) -> Result<Vec<Evaluated>, Stop> {
        let (influence, goals) = (self.influence, self.goals);
        let each = NonZeroUsize::new(self.threads.get() / begun.len().max(1)).unwrap_or(NonZeroUsize::MIN);
        on_threads(begun, self.threads, |(set, near)| {
            let matrices: Vec<Setups<'_>> = set.beams().iter().map(|beam| influence.beam(*beam)).collect();
            let columns: Vec<usize> = matrices.iter().map(Setups::columns).collect();
            let start = start_weights(set, &columns, *near);
            let plan = solve_beams(goals, &matrices, start.as_deref(), tolerance, each)?;
            Ok(Evaluated::new(set, &columns, plan))
        })
    }
}

impl<I: Influence + ?Sized> Solver for Local<'_, I> {
    fn solve(
        &mut self,
        sets: &[&BeamSet],
        near: Option<&Evaluated>,
        tolerance: f64,
    ) -> Result<Vec<Evaluated>, Stop> {
        let begun: Vec<Begun<'_>> = sets.iter().map(|set| (*set, near)).collect();
        self.solve_begun(&begun, tolerance)
    }

    fn price(&mut self, base: Option<&Evaluated>, candidates: &[u16]) -> Result<Vec<f64>, Stop> {
        let influence = self.influence;
        let slopes = slopes_at(self.goals, base.map(|base| &base.plan))?;
        let short = influence.shortlist(base, candidates);
        on_threads(candidates, self.threads, |candidate| match &short {
            Some(short) if !short.contains(candidate) => Ok(f64::NEG_INFINITY),
            _ => Ok(price_beam(self.goals, &slopes, &influence.beam(*candidate))?),
        })
    }
}

/// The best fluence of these beams to this part of their optimum, from weights of their bixels where there are some, on
/// these threads.
///
/// # Errors
/// The goals and matrices make no problem.
pub fn solve_beams(
    goals: &Goals,
    matrices: &[Setups<'_>],
    start: Option<&[f64]>,
    tolerance: f64,
    threads: NonZeroUsize,
) -> Result<Plan, GoalsError> {
    let options = Options { tolerance, ..Options::DEFAULT };
    Ok(solve_plan(&goals.problem(matrices)?.on_threads(threads), start, options)?)
}

/// The price of each of these beams beside a plan, or beside no beam.
///
/// # Errors
/// The goals and matrices make no problem.
pub fn price_beams(
    goals: &Goals,
    base: Option<&Plan>,
    matrices: &[Setups<'_>],
) -> Result<Vec<f64>, GoalsError> {
    let slopes = slopes_at(goals, base)?;
    matrices.iter().map(|beam| price_beam(goals, &slopes, beam)).collect()
}

/// The weights with which the solve of a set begins, given the number of bixels of each of its beams. A beam that the
/// neighbouring set lacks starts with the mean weight of the bixels of that set.
pub fn start_weights(set: &BeamSet, columns: &[usize], near: Option<&Evaluated>) -> Option<Vec<f64>> {
    let near = near.filter(|near| near.plan.weights.iter().any(|w| *w > 0.0))?;
    let mean = near.plan.weights.iter().sum::<f64>() / near.plan.weights.len() as f64;
    let mut weights = Vec::with_capacity(columns.iter().sum());
    for (beam, count) in set.beams().iter().zip(columns) {
        match near.weights_of(*beam) {
            Some(known) => weights.extend_from_slice(known),
            None => weights.resize(weights.len() + count, mean),
        }
    }
    Some(weights)
}

pub(super) fn slopes_at(goals: &Goals, base: Option<&Plan>) -> Result<Slopes, GoalsError> {
    match base {
        Some(plan) => Ok(Slopes::new(goals, plan)),
        None => Ok(Slopes::new(goals, &solve_beams(goals, &[], None, SOLVE_TOLERANCE, NonZeroUsize::MIN)?)),
    }
}

fn price_beam(goals: &Goals, slopes: &Slopes, beam: &Setups<'_>) -> Result<f64, GoalsError> {
    match beam.rows() == goals.rows() {
        true => Ok(promise(beam, slopes)),
        false => Err(GoalsError::Grid { found: beam.rows(), expected: goals.rows() }),
    }
}
