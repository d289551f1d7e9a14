//! A plan in one call.

use stillpoint_patient::case::Case;
use thiserror::Error;

use super::doses::PlanDoses;
use super::request::{PlanRequest, RequestError};
use super::search::PlanRun;
use super::setup::{PlanSetup, SetupError};
use super::spec::SetupSpec;
use crate::beams::{ChoiceError, Evaluated};
use crate::dose::CacheError;

/// A plan with all that it was made of.
pub struct Planned {
    /// The case made ready.
    pub setup: PlanSetup,
    /// The doses of the beams that the search could use.
    pub doses: PlanDoses,
    /// The search.
    pub run: PlanRun,
}

/// The reasons why there is no plan.
#[derive(Debug, Error)]
pub enum PlanError {
    /// The case cannot be planned.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// The request cannot be planned.
    #[error(transparent)]
    Request(#[from] RequestError),
    /// A dose cannot be computed.
    #[error(transparent)]
    Doses(#[from] CacheError),
    /// No set of beams was solved.
    #[error(transparent)]
    Choice(#[from] ChoiceError),
}

impl Planned {
    /// The best set of beams with its fluence.
    pub fn best(&self) -> &Evaluated {
        &self.run.choice.best
    }

    /// Gantry angles of the beams, rising, degrees.
    pub fn angles_deg(&self) -> Vec<f64> {
        self.setup.angles_deg(self.best().beams.beams())
    }
}

/// Plans a case: the doses are computed in memory. By [`super::PlanEngine::Auto`] the beams that were found are planned again
/// by superposition where they need it: the doses and the fluence are those, and the history is that of the search.
///
/// # Errors
/// The case or the request cannot be planned.
pub fn plan(case: Case, spec: SetupSpec, request: &PlanRequest) -> Result<Planned, PlanError> {
    let search = request.check(&case, spec.directions())?;
    let mut setup = PlanSetup::new(case, spec)?;
    if let Some(beams) = search.only_beams() {
        let engine = setup.engine_of_plan(&beams).map_err(SetupError::Dose)?;
        setup = setup.by(engine)?;
    }
    let doses = PlanDoses::compute(&setup, &search.needed_beams(), search.threads)?;
    let run = {
        let second = doses.second_player(&setup);
        search.run(search.evaluator(&setup, &doses, second.as_ref()))?
    };
    let found = &run.choice.best;
    let engine = setup.engine_of_plan(found.beams.beams()).map_err(SetupError::Dose)?;
    if engine == setup.engine_name() {
        let (doses, run) = search.settle(&setup, doses, run)?;
        return Ok(Planned { setup, doses, run });
    }
    let last = search.of_beams(&found.beams);
    let setup = setup.by(engine)?;
    let doses = PlanDoses::compute(&setup, &last.needed_beams(), search.threads)?;
    let solved = {
        let second = doses.second_player(&setup);
        last.run(last.evaluator(&setup, &doses, second.as_ref()))?
    };
    let (doses, solved) = last.settle(&setup, doses, solved)?;
    Ok(Planned { setup, doses, run: PlanRun { choice: solved.choice, ..run } })
}
