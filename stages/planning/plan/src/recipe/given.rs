//! A plan of weights that another program made.

use thiserror::Error;

use super::doses::PlanDoses;
use super::search::{PlanRun, PlanSearch};
use super::setup::PlanSetup;
use crate::beams::{Choice, Evaluated, Influence, Progress, RingError};
use crate::dose::DoseError;
use crate::fluence::{GoalsError, ProblemError, given_plan};

/// The reasons why weights make no plan.
#[derive(Debug, Error)]
pub enum GivenError {
    /// The beams are not known without a search.
    #[error("weights need their beams: give their gantry angles")]
    NoBeams,
    /// The robust game judges other doses than the weights were made for.
    #[error("weights cannot be evaluated in the robust game of the worst set-up")]
    Game,
    /// The beams are no set of the ring.
    #[error(transparent)]
    Ring(#[from] RingError),
    /// The goals and matrices make no problem.
    #[error(transparent)]
    Goals(#[from] GoalsError),
    /// The dose of the weights cannot be computed.
    #[error(transparent)]
    Dose(#[from] DoseError),
    /// The weights do not fit the bixels.
    #[error(transparent)]
    Weights(#[from] ProblemError),
}

impl PlanSearch {
    /// The plan of these weights: one for each bixel of the given beams, by rising gantry angle, in the order of
    /// [`crate::beams::RingDoses::bixels_mm`]. Nothing is optimised.
    ///
    /// # Errors
    /// The beams are not given, or the weights do not fit them.
    pub fn of_weights(
        &self,
        setup: &PlanSetup,
        doses: &PlanDoses,
        weights: &[f64],
    ) -> Result<PlanRun, GivenError> {
        let beams = self.only_beams().ok_or(GivenError::NoBeams)?;
        if setup.parts.is_some() {
            return Err(GivenError::Game);
        }
        let set = setup.directions.set(&beams)?;
        let matrices: Vec<_> = set.beams().iter().map(|beam| doses.solved.beam(*beam)).collect();
        let columns: Vec<usize> = matrices.iter().map(|matrix| matrix.columns()).collect();
        let problem = setup.goals.problem(&matrices)?.on_threads(self.threads);
        let best = Evaluated::new(&set, &columns, given_plan(&problem, weights)?);
        let only =
            Progress { solves: 0, prices: 0, cost: best.cost, best: best.cost, beams: set, from: None };
        Ok(PlanRun {
            name: self.name,
            budget: 0,
            leaves: self.leaves,
            choice: Choice { best: best.into(), spent: false },
            history: vec![only],
            prices: 0,
            directions: self.directions.clone(),
        })
    }
}
