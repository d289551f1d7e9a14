//! What a plan makes of its objectives: the cost of each, and beside it the quantity that it bounds as it truly is.

use serde::{Deserialize, Serialize};

use super::set::ObjectiveSet;
use crate::evaluation::Evaluation;
use crate::fluence::{Goals, GoalsError, Measured, Objective, StructureObjectives};

/// An objective of a plan with what the plan gives.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ObjectiveResult {
    /// The structure, or the part of it.
    pub structure: String,
    /// The objective.
    pub objective: Objective,
    /// Its part of the cost, in the mean over the set-ups, at the points that were optimised. For a DVH point it is the cost
    /// of its surrogate.
    pub cost: f64,
    /// The quantity that it bounds, of the evaluated dose to the whole structure; nothing where it bounds no single quantity.
    pub measured: Option<Measured>,
    /// Whether that is on its side of the limit.
    pub met: Option<bool>,
}

impl ObjectiveSet {
    /// What a plan makes of each objective, in their order: `goals` are those of this set with which it was solved, `dose` is
    /// that of their voxels (Gy), and `evaluation` that of the whole structures.
    ///
    /// # Errors
    /// The goals are of another set.
    pub fn results(
        &self,
        goals: &Goals,
        dose: &[f64],
        evaluation: &Evaluation<'_>,
    ) -> Result<Vec<ObjectiveResult>, GoalsError> {
        if dose.len() != goals.voxels().len() {
            return Err(GoalsError::Grid { found: dose.len(), expected: goals.voxels().len() });
        }
        let mut of_rows = vec![0.0; goals.rows()];
        for (voxel, gray) in goals.voxels().iter().zip(dose) {
            of_rows[*voxel as usize] = *gray;
        }
        let setups = goals.rows() / self.rows.max(1);
        let mut solved = goals.structures().iter().peekable();
        let mut results = Vec::new();
        for (structure, moves) in self.structures.iter().zip(&self.moves) {
            let mut costs = vec![0.0; structure.objectives.len()];
            // A structure stands in the goals once for each set-up that it is followed through.
            let alike = |other: &&StructureObjectives| {
                other.name == structure.name && other.objectives.len() == structure.objectives.len()
            };
            for _ in 0..if *moves { setups } else { 1 } {
                let Some(solved) = solved.next_if(alike) else {
                    return Err(GoalsError::Grid { found: goals.rows(), expected: self.rows });
                };
                costs.iter_mut().zip(solved.costs(&of_rows)).for_each(|(sum, cost)| *sum += cost);
            }
            let found = evaluation.histograms.iter().find(|(s, _)| s.name == structure.name);
            for (objective, cost) in structure.objectives.iter().zip(costs) {
                let measured = found.and_then(|(_, dvh)| objective.measure(dvh));
                let met = measured.as_ref().map(Measured::met);
                let (structure, objective) = (structure.name.clone(), *objective);
                results.push(ObjectiveResult { structure, objective, cost, measured, met });
            }
        }
        Ok(results)
    }
}
