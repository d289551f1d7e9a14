//! What given doses cost, without a problem to solve.

use super::goals::{Goals, GoalsError, StructureObjectives};
use super::plan::Plan;

impl Goals {
    /// What the doses of a plan cost, without the modulation of its fluence.
    ///
    /// # Errors
    /// The plan is of other goals.
    pub fn cost_of(&self, plan: &Plan) -> Result<f64, GoalsError> {
        let (found, expected) = (plan.dose.len(), self.voxels().len());
        if found != expected {
            return Err(GoalsError::Grid { found, expected });
        }
        let mut dose = vec![0.0; self.rows()];
        self.voxels().iter().zip(&plan.dose).for_each(|(voxel, gray)| dose[*voxel as usize] = *gray);
        self.cost(&dose)
    }

    /// The cost of doses that are there: one for each row of a dose matrix, Gy.
    ///
    /// # Errors
    /// The doses are of another grid.
    pub fn cost(&self, dose: &[f64]) -> Result<f64, GoalsError> {
        if dose.len() != self.rows() {
            return Err(GoalsError::Grid { found: dose.len(), expected: self.rows() });
        }
        let mut cost = 0.0;
        for structure in self.structures() {
            for of_objective in structure.costs(dose) {
                cost += of_objective;
            }
        }
        Ok(cost)
    }
}

impl StructureObjectives {
    /// The cost of each of its objectives at doses of the rows of a dose matrix, Gy.
    pub fn costs(&self, dose: &[f64]) -> Vec<f64> {
        let volume = |at: usize| self.volumes.get(at).copied().unwrap_or(1.0);
        let voxels = self.voxels.iter().enumerate();
        let points: Vec<(f64, f64)> = voxels.map(|(at, v)| (dose[*v as usize], volume(at))).collect();
        self.objectives.iter().map(|objective| objective.cost(&points, &self.to_target_mm)).collect()
    }
}
