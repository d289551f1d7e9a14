//! The last solve of a plan by superposition: on columns that are corrected by the superposition of its own fluence.
//!
//! The columns of bixels share the scatter of the open field, and end at the cutoff. A fluence that is modulated has another
//! scatter: more comes from where weights are high, also from beyond the cutoff. So the dose of the fluence is computed as a
//! whole at the points, each point's row of the columns is multiplied by the ratio, and the fluence is solved again from
//! where it is. The second fluence is near the first, and so is its ratio.

use std::num::NonZeroUsize;

use super::doses::PlanDoses;
use super::given::GivenError;
use super::plan::PlanError;
use super::search::{PlanRun, PlanSearch};
use super::setup::PlanSetup;
use crate::beams::{Choice, ChoiceError, Evaluated};
use crate::dose::{CacheError, DoseError, EngineName};

/// How often the columns are corrected.
const ROUNDS: usize = 1;

impl PlanDoses {
    /// The doses of the beams of a plan, so that its weights give what the engines of the set-up compute of its whole
    /// fluence at each point.
    ///
    /// # Errors
    /// A dose cannot be computed.
    pub fn corrected(
        &self,
        setup: &PlanSetup,
        plan: &Evaluated,
        threads: NonZeroUsize,
    ) -> Result<Self, DoseError> {
        let (solved, errors) = setup.engines().split_at(setup.solved_setups());
        let of_errors = self.errors.as_ref().map(|doses| doses.corrected(errors, plan, threads));
        Ok(Self { solved: self.solved.corrected(solved, plan, threads)?, errors: of_errors.transpose()? })
    }
}

impl PlanSearch {
    /// The best plan of a run, solved again on corrected columns, and these. Plans by pencil beams stay as they are: their
    /// columns are what their dose is made of.
    ///
    /// # Errors
    /// A dose cannot be computed, or the fluence cannot be solved.
    pub fn settle(
        &self,
        setup: &PlanSetup,
        doses: PlanDoses,
        run: PlanRun,
    ) -> Result<(PlanDoses, PlanRun), PlanError> {
        let (mut doses, mut run) = (doses, run);
        if setup.engine_name() == EngineName::Pencil {
            return Ok((doses, run));
        }
        for _ in 0..ROUNDS {
            let best = &run.choice.best;
            doses = doses.corrected(setup, best, self.threads).map_err(CacheError::Dose)?;
            let solved = {
                let second = doses.second_player(setup);
                let last = self.of_beams(&best.beams);
                let mut evaluator = last.evaluator(setup, &doses, second.as_ref()).fine();
                evaluator.evaluate(&best.beams, Some(best)).map_err(ChoiceError::Stop)?
            };
            run.choice = Choice { best: solved, ..run.choice };
        }
        Ok((doses, run))
    }

    /// The plan of given weights on columns that are corrected for them, and these.
    ///
    /// # Errors
    /// A dose cannot be computed, or the weights do not fit the beams.
    pub fn settle_weights(
        &self,
        setup: &PlanSetup,
        doses: PlanDoses,
        run: PlanRun,
    ) -> Result<(PlanDoses, PlanRun), GivenError> {
        if setup.engine_name() == EngineName::Pencil {
            return Ok((doses, run));
        }
        let best = &run.choice.best;
        let doses = doses.corrected(setup, best, self.threads)?;
        let run = self.of_weights(setup, &doses, &best.plan.weights)?;
        Ok((doses, run))
    }
}
