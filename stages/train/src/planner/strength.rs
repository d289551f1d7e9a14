//! What the sets of a model cost beside the sets of habit, on cases outside of training.

use std::num::NonZeroUsize;

use serde::Serialize;
use stillpoint_network::{Eye, Model};
use stillpoint_plan::dose::Machine;

use super::gather::{BEAMS, SolvedCase, costs};
use super::problem::{Problem, plan, ring};
use crate::TrainError;

/// Costs of one case, in percent above the best set that is known.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Strength {
    /// Seed of the varied pelvis.
    pub seed: u64,
    /// The class set, one solve.
    pub class: f64,
    /// The best rotation of equal beams, 18 solves.
    pub rotation: f64,
    /// Mean over the rotations: what one rotation costs, one solve.
    pub one_rotation: f64,
    /// The model's sets, the one of the best value first.
    pub model: Vec<f64>,
}

/// Means over cases, in percent above the best known.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Cases.
    pub cases: usize,
    /// The class set.
    pub class: f64,
    /// The best rotation.
    pub rotation: f64,
    /// The mean rotation.
    pub one_rotation: f64,
    /// The model's first set.
    pub model_1: f64,
    /// The best of the model's first five sets.
    pub model_5: f64,
    /// Cases in which the model's first set beats the class set.
    pub ahead_of_class: usize,
    /// Cases in which the model's first set beats the best rotation.
    pub ahead_of_rotation: usize,
}

/// Solves the `most` best sets of a model, and adds them to the solved case.
pub fn strength(
    model: &Model,
    case: &mut SolvedCase,
    most: usize,
    threads: NonZeroUsize,
) -> Result<Strength, TrainError> {
    let problem = Problem::of_seed(case.seed, case.by.coarse)?;
    let (ring, machine) = (ring()?, Machine::shipped().map_err(plan)?);
    let eye =
        Eye::of_case(&problem.case, &problem.wanted, &machine, usize::from(ring.count())).map_err(plan)?;
    let sets = model.judge(&eye).best_sets(ring, BEAMS, most).map_err(plan)?;
    let found = costs(case.seed, case.by.coarse, &sets, threads)?;
    case.add(sets.iter().map(|set| set.beams().to_vec()).zip(found.iter().copied()));
    let best = case.best();
    let above = |cost: f64| 100.0 * (cost / best - 1.0);
    let rotations = case.rotations.len().max(1) as f64;
    Ok(Strength {
        seed: case.seed,
        class: above(case.class),
        rotation: above(case.rotations.iter().copied().fold(f64::INFINITY, f64::min)),
        one_rotation: case.rotations.iter().map(|c| above(*c)).sum::<f64>() / rotations,
        model: found.into_iter().map(above).collect(),
    })
}

impl Summary {
    /// Of these cases.
    pub fn of(all: &[Strength]) -> Self {
        let mean = |of: &dyn Fn(&Strength) -> f64| all.iter().map(of).sum::<f64>() / all.len().max(1) as f64;
        let first = |s: &Strength| s.model.first().copied().unwrap_or(f64::NAN);
        let five = |s: &Strength| s.model.iter().take(5).copied().fold(f64::INFINITY, f64::min);
        Self {
            cases: all.len(),
            class: mean(&|s| s.class),
            rotation: mean(&|s| s.rotation),
            one_rotation: mean(&|s| s.one_rotation),
            model_1: mean(&first),
            model_5: mean(&five),
            ahead_of_class: all.iter().filter(|s| first(s) < s.class).count(),
            ahead_of_rotation: all.iter().filter(|s| first(s) < s.rotation).count(),
        }
    }
}
