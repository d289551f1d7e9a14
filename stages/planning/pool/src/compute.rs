//! The pure functions: a call and its arguments give bytes.

use std::num::NonZeroUsize;
use std::sync::Arc;

use stillpoint_network::game::play_on;
use stillpoint_network::{Model, Patient, Rules};
use stillpoint_patient::case::Case;
use stillpoint_plan::Setups;
use stillpoint_plan::beams::{checked_tolerance, price_beams, solve_beams};
use stillpoint_plan::dose::{BeamAngles, BeamFile, DoseEngine};
use stillpoint_plan::fluence::{Goals, Plan};

use crate::{CallError, answer};

/// A call whose arguments are at hand.
pub enum Ready {
    /// The dose of a beam.
    Dose {
        /// The engine.
        engine: Arc<DoseEngine>,
        /// Where the beam comes from.
        angles: BeamAngles,
    },
    /// The best fluence of beams.
    Solve {
        /// The goals.
        goals: Arc<Goals>,
        /// Doses of each beam in each set-up.
        beams: Vec<Vec<Arc<BeamFile>>>,
        /// Weights to begin with.
        start: Option<Vec<f64>>,
        /// Relative excess aimed at.
        tolerance: f64,
    },
    /// Prices of beams.
    Price {
        /// The goals.
        goals: Arc<Goals>,
        /// The plan beside which they are priced.
        base: Option<Arc<Plan>>,
        /// Doses of each candidate in each set-up.
        candidates: Vec<Vec<Arc<BeamFile>>>,
    },
    /// A game.
    Game {
        /// The network; none for an opening.
        network: Option<Arc<Model>>,
        /// The case of a patient who is no phantom.
        case: Option<Box<Case>>,
        /// Whose beams are chosen.
        patient: Patient,
        /// The seed.
        seed: u64,
        /// The rules.
        rules: Rules,
    },
}

impl Ready {
    /// The answer. It does not depend on time, threads or the machine beyond what a [`crate::Build`] names.
    ///
    /// # Errors
    /// The arguments do not fit each other.
    pub fn compute(&self) -> Result<Vec<u8>, CallError> {
        match self {
            Self::Dose { engine, angles } => engine.beam_file(*angles).map_err(CallError::of),
            Self::Solve { goals, beams, start, tolerance } => {
                let tolerance = checked_tolerance(*tolerance).map_err(CallError::of)?;
                let plan =
                    solve_beams(goals, &setups(beams)?, start.as_deref(), tolerance, NonZeroUsize::MIN);
                let plan = plan.map_err(CallError::of)?;
                Ok(answer::of_plan(&plan))
            }
            Self::Price { goals, base, candidates } => {
                let prices = price_beams(goals, base.as_deref(), &setups(candidates)?);
                Ok(answer::of_prices(&prices.map_err(CallError::of)?))
            }
            Self::Game { network, case, patient, seed, rules } => {
                let problem = match case {
                    Some(case) => patient.problem_of(Case::clone(case)),
                    None => patient.problem(),
                };
                let problem = problem.map_err(CallError::of)?;
                let game = play_on(&problem, network.as_deref(), patient, *seed, *rules, NonZeroUsize::MIN);
                game.and_then(|game| game.to_bytes()).map_err(CallError::of)
            }
        }
    }
}

fn setups(beams: &[Vec<Arc<BeamFile>>]) -> Result<Vec<Setups<'_>>, CallError> {
    let mut all = Vec::with_capacity(beams.len());
    for setups in beams {
        let together =
            Setups::new(setups.iter().map(|dose| dose.dose()).collect()).ok_or(CallError::Uneven)?;
        all.push(together.placed(setups.first().map_or(&[], |dose| dose.bixels_mm())));
    }
    Ok(all)
}
