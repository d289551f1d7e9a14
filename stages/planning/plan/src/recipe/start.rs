//! A plan that begins with the fluence of another one: planning again on another image, or with other objectives.
//!
//! The problem of given beams is convex, so the plan is the same as without a start, to the tolerance of a solve. Near the
//! fluence of the other plan it is found in fewer steps.

use thiserror::Error;

use super::doses::PlanDoses;
use super::given::GivenError;
use super::search::{PlanRun, PlanSearch};
use super::setup::PlanSetup;
use crate::beams::{Choice, Stop};
use crate::recompute::BeamFluence;

/// The fluence with which a solve begins.
#[derive(Clone, Debug, PartialEq)]
pub struct StartFluence {
    /// The beams of the other plan.
    pub beams: Vec<BeamFluence>,
    /// Width of their bixels, mm.
    pub bixel_mm: f64,
}

/// The reasons why a plan cannot begin with the fluence of another one.
#[derive(Debug, Error)]
pub enum StartError {
    /// The weights cannot be a start.
    #[error(transparent)]
    Given(#[from] GivenError),
    /// The fluence cannot be solved.
    #[error(transparent)]
    Stop(#[from] Stop),
    /// The other plan has no fluence where the beams have bixels.
    #[error(
        "no bixel with weight of the plan to start from is where a beam of this plan has one: plan without a start"
    )]
    Apart,
}

impl StartFluence {
    /// The weight at a place of the isocentre plane (mm), of the beam that this number names among the directions.
    fn weight(&self, setup: &PlanSetup, beam: u16, place: [f64; 2]) -> f64 {
        let half_mm = 0.5 * self.bixel_mm;
        let is_here = |bixel: &[f64; 2]| (0..2).all(|axis| (bixel[axis] - place[axis]).abs() <= half_mm);
        let beams = self.beams.iter().filter(|other| setup.directions.beam(other.angles) == Some(beam));
        let here = beams.flat_map(|other| other.bixels_mm.iter().zip(&other.weights));
        here.filter(|(bixel, _)| is_here(bixel)).map(|(_, weight)| *weight).next().unwrap_or(0.0)
    }
}

impl PlanSearch {
    /// The plan of the given beams, solved from the fluence of another plan: a bixel begins with the weight that the other
    /// plan has at its centre.
    ///
    /// # Errors
    /// The beams are not given, the plans share no fluence, or it cannot be solved.
    pub fn starting_from(
        &self,
        setup: &PlanSetup,
        doses: &PlanDoses,
        start: &StartFluence,
    ) -> Result<PlanRun, StartError> {
        let beams = self.only_beams().ok_or(GivenError::NoBeams)?;
        let of_beam = |beam: &u16| {
            let bixels_mm = doses.solved.bixels_mm(*beam).iter();
            bixels_mm.map(|place| start.weight(setup, *beam, *place)).collect::<Vec<f64>>()
        };
        let weights: Vec<f64> = beams.iter().flat_map(of_beam).collect();
        if weights.iter().all(|weight| *weight == 0.0) {
            return Err(StartError::Apart);
        }
        let begin = self.of_weights(setup, doses, &weights)?.choice.best;
        let mut evaluator = self.of_beams(&begin.beams).evaluator(setup, doses, None);
        let best = evaluator.evaluate(&begin.beams, Some(&begin))?;
        let (history, prices) = (evaluator.history().to_vec(), evaluator.prices());
        let choice = Choice { best, spent: false };
        let directions = setup.directions.clone();
        Ok(PlanRun { name: self.name, directions, budget: 1, leaves: self.leaves, choice, history, prices })
    }
}
