//! The second player of the robust game: it answers a plan with the set-up error under which the plan costs most.
//!
//! The first player chooses beams, and their fluence is the best one for the planned set-up; the second picks an error from
//! a list (SCIENCE G6, reading b). The list is short, so that its best answer is found by trying all: the value of a set is
//! exact, and needs no tree.

use super::evaluator::Evaluated;
use crate::fluence::{Goals, GoalsError};
use crate::{Rows, RowsRef};

/// What it takes to judge a plan under one error, as a part of a solve; `stillpoint-research optimum --set-up-error`
/// measures it.
pub const SHARE_OF_A_SOLVE: f64 = 0.02;

/// The dose matrices of the beams of a ring for set-up errors.
pub trait Displaced: Sync {
    /// How many errors there are.
    fn errors(&self) -> usize;
    /// The matrix of a beam under an error: rows are voxels of the dose grid, columns its bixels. `None` if it has no dose.
    fn beam(&self, beam: u16, error: usize) -> Option<RowsRef<'_>>;
}

/// What is followed under set-up errors, and with which doses.
pub struct SecondPlayer<'a> {
    /// Doses under each error.
    pub doses: &'a dyn Displaced,
    /// Goals of what moves with the patient through the beams; rows are voxels of the dose grid.
    pub moving: &'a Goals,
    /// Goals that count in the planned set-up only.
    pub still: &'a Goals,
    /// Goals for which plans are solved: the sum of both.
    pub all: &'a Goals,
}

/// The answer to a plan.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// What the plan costs under each error of the list.
    pub costs: Vec<f64>,
    /// The error under which it costs most; `None` if no error costs more than the planned set-up.
    pub error: Option<usize>,
}

impl Answer {
    /// The error of the most cost, the first among equals, beside what the plan costs without an error.
    fn of(costs: Vec<f64>, planned: f64) -> (f64, Self) {
        let worse = |worst: (f64, Option<usize>), (error, cost): (usize, &f64)| {
            if *cost > worst.0 { (*cost, Some(error)) } else { worst }
        };
        let (worst, error) = costs.iter().enumerate().fold((planned, None), worse);
        (worst, Self { costs, error })
    }
}

impl SecondPlayer<'_> {
    /// What the answer to one plan takes, as a part of a solve.
    pub fn share(&self) -> f64 {
        SHARE_OF_A_SOLVE * self.doses.errors() as f64
    }

    /// The answer to a plan, and what the plan then costs.
    ///
    /// # Errors
    /// Doses are of another grid than the goals.
    pub fn answer(&self, solved: &Evaluated) -> Result<(f64, Answer), GoalsError> {
        let mut dose = vec![0.0; self.still.rows()];
        for (voxel, gray) in self.all.voxels().iter().zip(&solved.plan.dose) {
            dose[*voxel as usize] = *gray;
        }
        // Errors are compared by doses, which the modulation of the fluence is no part of.
        let planned = match self.all.modulation() {
            None => solved.plan.certificate.objective,
            Some(_) => self.all.cost(&dose)?,
        };
        let still = self.still.cost(&dose)?;
        let mut costs = Vec::with_capacity(self.doses.errors());
        for error in 0..self.doses.errors() {
            costs.push(still + self.moving.cost(&self.dose(solved, error)?)?);
        }
        Ok(Answer::of(costs, planned))
    }

    /// Dose of a plan under an error to the rows of what moves, Gy; 0 elsewhere.
    fn dose(&self, solved: &Evaluated, error: usize) -> Result<Vec<f64>, GoalsError> {
        let mut dose = vec![0.0; self.moving.rows()];
        for beam in solved.beams.beams() {
            let matrix = self.doses.beam(*beam, error);
            let (Some(matrix), Some(weights)) = (matrix, solved.weights_of(*beam)) else { continue };
            if matrix.rows() != dose.len() {
                return Err(GoalsError::Grid { found: matrix.rows(), expected: dose.len() });
            }
            for voxel in self.moving.voxels() {
                let (columns, values) = matrix.row(*voxel as usize);
                let gray = columns.iter().zip(values).map(|(c, v)| f64::from(*v) * weights[usize::from(*c)]);
                dose[*voxel as usize] += gray.sum::<f64>();
            }
        }
        Ok(dose)
    }
}

/// By error, then by beam of the ring.
impl Displaced for Vec<Vec<Rows>> {
    fn errors(&self) -> usize {
        self.len()
    }

    fn beam(&self, beam: u16, error: usize) -> Option<RowsRef<'_>> {
        self.get(error)?.get(usize::from(beam)).map(Rows::view)
    }
}
