//! Beams that leaves cannot shape are refused before their doses are computed.

use thiserror::Error;

use super::search::PlanSearch;
use super::setup::PlanSetup;
use crate::dose::{BeamAngles, BixelSpec, Collimator, DoseEngine, DoseError, DoseParams};
use crate::leaves::{LeavesError, within_leaves};

/// The reasons why leaves cannot shape the beams of a plan.
#[derive(Debug, Error)]
pub enum UnshapedError {
    /// A beam of the plan needs a bixel where leaves cannot shape it, or too few of those that a search may choose have none.
    #[error("the beam at {angles} degrees: {why}")]
    Beam {
        /// The beam.
        angles: BeamAngles,
        /// Its first such bixel.
        why: LeavesError,
    },
    /// The bixels of a beam are not known.
    #[error(transparent)]
    Dose(#[from] DoseError),
}

impl PlanSetup {
    /// Refuses a search whose plan is sequenced for these leaves where they cannot shape so many of its beams as the plan has.
    /// No dose is computed. The bixels that count are those of the target with the least margin (a voxel), whatever weight a
    /// solve would give them: those of the margin beyond often get none.
    ///
    /// # Errors
    /// The first beam that cannot be shaped, with its first bixel.
    pub fn check_leaves(&self, search: &PlanSearch, collimator: &Collimator) -> Result<(), UnshapedError> {
        let params = self.engine().params();
        let params = DoseParams { bixels: BixelSpec { margin_mm: 0.0, ..params.bixels }, ..*params };
        let of_target = DoseEngine::of_case(&self.case, self.spec.machine.clone(), params)?;
        let (mut shaped, mut unshaped) = (0, None);
        for angles in self.directions.all(&search.needed_beams()) {
            let bixels = of_target.bixels_mm(angles)?;
            match within_leaves(collimator, bixels, self.spec.bixel_mm) {
                Ok(()) => shaped += 1,
                Err(why) => {
                    unshaped.get_or_insert(UnshapedError::Beam { angles, why });
                }
            }
            if shaped == search.beams {
                return Ok(());
            }
        }
        unshaped.map_or(Ok(()), Err)
    }
}
