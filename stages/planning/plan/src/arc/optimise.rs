//! The rounds of an arc: sweeps over the leaves, then the weights, until nothing is gained.

use std::num::NonZeroUsize;

use super::ArcError;
use super::field::ArcField;
use super::start::start;
use super::sweep::sweep;
use super::trajectory::{Bounds, Trajectory};
use super::weights::improve;
use crate::fluence::Goals;

/// When an arc is good enough.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArcOptions {
    /// Most rounds.
    pub rounds: usize,
    /// The part of the objective that a round gains at least, or it is the last.
    pub least_gain: f64,
}

impl Default for ArcOptions {
    fn default() -> Self {
        Self { rounds: 40, least_gain: 3e-4 }
    }
}

/// An arc with the course of its objective.
#[derive(Clone, Debug, PartialEq)]
pub struct Optimised {
    /// Leaves and weights, with tips at whole micrometres.
    pub trajectory: Trajectory,
    /// Dose of the rows of the goals, gray.
    pub dose: Vec<f64>,
    /// The objective: of the start, and after each round. It never rises.
    pub objectives: Vec<f64>,
    /// The objective with tips at whole micrometres.
    pub objective: f64,
}

/// Optimises arcs on the doses of their cells. Nothing is drawn, and any number of threads gives the same bytes. `on_round` is called with the
/// objective after each round.
///
/// # Errors
/// The goals make no problem, or no aperture lessens the objective.
pub fn optimise(
    field: &ArcField,
    goals: &Goals,
    bounds: &Bounds,
    options: ArcOptions,
    threads: NonZeroUsize,
    on_round: impl Fn(usize, f64),
) -> Result<Optimised, ArcError> {
    let mut trajectory = start(field, goals, bounds, threads)?;
    let mut running = improve(field, goals, bounds, &mut trajectory, threads)?;
    let mut objectives = vec![running.cost()];
    on_round(0, running.cost());
    for round in 1..=options.rounds {
        let before = running.cost();
        sweep(field, bounds, &mut trajectory, &mut running, false);
        sweep(field, bounds, &mut trajectory, &mut running, true);
        running = improve(field, goals, bounds, &mut trajectory, threads)?;
        objectives.push(running.cost());
        on_round(round, running.cost());
        if running.cost() > before * (1.0 - options.least_gain) {
            break;
        }
    }
    let mut trajectory = trajectory.on_grid();
    let last = improve(field, goals, bounds, &mut trajectory, threads)?;
    if let Some(fault) = trajectory.fault(field, bounds) {
        return Err(ArcError::Limit(fault));
    }
    Ok(Optimised { trajectory, dose: last.dose().to_vec(), objective: last.cost(), objectives })
}
