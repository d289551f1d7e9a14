//! The weights of intervals while the leaves stay as they are: a convex problem.

use std::num::NonZeroUsize;

use super::ArcError;
use super::field::ArcField;
use super::trajectory::{Bounds, Trajectory};
use crate::fluence::{DoseChange, Goals, Options, RunningCost, solve_plan};
use crate::threads::on_threads;
use crate::{Rows, Setups};

/// Accuracy of the weights.
const ACCURACY: Options = Options { tolerance: 1e-5, ..Options::DEFAULT };
/// Rounds over all weights where a bound holds one.
const ROUNDS: usize = 4;

/// Doses of apertures or intervals, each for a weight of 1.
#[derive(Clone, Debug, Default)]
pub struct ArcColumns {
    /// Rows of the goals.
    dense: Vec<Vec<f64>>,
    /// The same as matrices of one column over all rows of the engine.
    matrices: Vec<Rows>,
}

impl ArcColumns {
    /// Adds a dose of the rows of the goals.
    ///
    /// # Errors
    /// It makes no matrix.
    pub fn push(&mut self, dose: Vec<f64>, goals: &Goals) -> Result<(), ArcError> {
        self.matrices.push(matrix(&dose, goals)?);
        self.dense.push(dose);
        Ok(())
    }

    /// The doses of all intervals of a trajectory.
    ///
    /// # Errors
    /// The doses make no matrix.
    pub fn of_intervals(
        field: &ArcField,
        trajectory: &Trajectory,
        goals: &Goals,
        threads: NonZeroUsize,
    ) -> Result<Self, ArcError> {
        let numbers: Vec<usize> = (0..field.intervals.len()).collect();
        let both = on_threads(&numbers, threads, |number| {
            let mut dose = vec![0.0; field.goal_rows()];
            trajectory.add_interval(field, *number, 1.0, &mut dose);
            Ok::<_, ArcError>((matrix(&dose, goals)?, dose))
        })?;
        let (matrices, dense) = both.into_iter().unzip();
        Ok(Self { dense, matrices })
    }

    /// The dose of weights, gray.
    pub fn dose(&self, rows: usize, weights: &[f64]) -> Vec<f64> {
        let mut sum = vec![0.0; rows];
        for (dose, weight) in self.dense.iter().zip(weights).filter(|(_, weight)| **weight != 0.0) {
            sum.iter_mut().zip(dose).for_each(|(sum, dose)| *sum += weight * dose);
        }
        sum
    }

    /// The change of the dose of a column by a weight.
    fn change(&self, column: usize, weight: f64, change: &mut DoseChange) {
        let dose = self.dense[column].iter().enumerate().filter(|(_, dose)| **dose != 0.0);
        dose.for_each(|(row, dose)| change.add(row as u32, weight * dose));
    }
}

fn matrix(dose: &[f64], goals: &Goals) -> Result<Rows, ArcError> {
    let mut all = vec![Vec::new(); goals.rows()];
    for (voxel, gray) in goals.voxels().iter().zip(dose).filter(|(_, gray)| **gray > 0.0) {
        all[*voxel as usize] = vec![(0_u16, *gray as f32)];
    }
    Ok(Rows::from_rows(1, all.into_iter())?)
}

/// The best weights without bounds but zero, from those that are there.
///
/// # Errors
/// The goals make no problem.
pub fn solved(goals: &Goals, columns: &ArcColumns, start: &[f64]) -> Result<Vec<f64>, ArcError> {
    let setups: Vec<Setups<'_>> = columns.matrices.iter().map(|matrix| matrix.view().into()).collect();
    Ok(solve_plan(&goals.problem(&setups)?, Some(start), ACCURACY)?.weights)
}

/// Better weights of the intervals within their bounds, where there are any; the cost never rises.
///
/// # Errors
/// The goals make no problem.
pub fn improve(
    field: &ArcField,
    goals: &Goals,
    bounds: &Bounds,
    trajectory: &mut Trajectory,
    threads: NonZeroUsize,
) -> Result<RunningCost, ArcError> {
    let columns = ArcColumns::of_intervals(field, trajectory, goals, threads)?;
    columns.improve(goals, &bounds.weights, &mut trajectory.weights)
}

impl ArcColumns {
    /// Better weights of these columns within bounds, where there are any, with what they cost; that never rises.
    ///
    /// # Errors
    /// The goals make no problem.
    pub fn improve(
        &self,
        goals: &Goals,
        bounds: &[[f64; 2]],
        weights: &mut Vec<f64>,
    ) -> Result<RunningCost, ArcError> {
        let rows = goals.voxels().len();
        let problem = goals.problem(&[])?;
        let running = |weights: &[f64]| problem.running(self.dose(rows, weights));
        let before = running(weights);
        let solved = solved(goals, self, weights)?;
        let is_within =
            solved.iter().zip(bounds).all(|(weight, [low, high])| (*low..=*high).contains(weight));
        if is_within {
            let after = running(&solved);
            if after.cost() < before.cost() {
                *weights = solved;
                return Ok(after);
            }
            return Ok(before);
        }
        let mut now = before;
        let mut change = DoseChange::new(rows);
        for _ in 0..ROUNDS {
            for (column, weight) in weights.iter_mut().enumerate() {
                let [low, high] = bounds[column];
                change.clear();
                self.change(column, 1.0, &mut change);
                let [slope, curvature] = now.along(&change);
                if curvature <= 0.0 {
                    continue;
                }
                let by = (*weight - slope / curvature).clamp(low, high) - *weight;
                change.clear();
                self.change(column, by, &mut change);
                let added = now.added(&change);
                if added < 0.0 {
                    now.make(&change, added);
                    *weight += by;
                }
            }
        }
        Ok(running(weights))
    }
}
