//! The doses of the beams of a set-up.

use std::num::NonZeroUsize;

use super::setup::PlanSetup;
use crate::beams::{RingDoses, SecondPlayer};
use crate::dose::{CacheError, DoseCache, DoseEngine};

/// The doses of some beams of the ring of a [`PlanSetup`].
#[derive(Debug)]
pub struct PlanDoses {
    /// Doses in the set-ups for which fluences are solved.
    pub solved: RingDoses,
    /// Doses under each set-up error of the robust game.
    pub(super) errors: Option<RingDoses>,
}

impl PlanDoses {
    /// The doses of these beams from a folder; those that it lacks are computed and stored there. `on_dose` is called for
    /// each dose.
    ///
    /// # Errors
    /// A dose cannot be computed, or the folder cannot be used.
    pub fn load(
        setup: &PlanSetup,
        cache: &DoseCache,
        beams: &[u16],
        threads: NonZeroUsize,
        on_dose: impl Fn() + Sync,
    ) -> Result<Self, CacheError> {
        Self::by(setup, |engines| {
            RingDoses::load(cache, engines, setup.directions.clone(), beams, threads, &on_dose)
        })
    }

    /// The doses of these beams, computed in memory.
    ///
    /// # Errors
    /// A dose cannot be computed.
    pub fn compute(setup: &PlanSetup, beams: &[u16], threads: NonZeroUsize) -> Result<Self, CacheError> {
        Self::by(setup, |engines| RingDoses::compute(engines, setup.directions.clone(), beams, threads))
    }

    fn by(
        setup: &PlanSetup,
        doses: impl Fn(&[DoseEngine]) -> Result<RingDoses, CacheError>,
    ) -> Result<Self, CacheError> {
        let (solved, errors) = setup.engines().split_at(setup.solved_setups());
        let errors = if errors.is_empty() { None } else { Some(errors) };
        Ok(Self { solved: doses(solved)?, errors: errors.map(&doses).transpose()? })
    }

    /// The second player of the robust game, where it is played.
    pub fn second_player<'a>(&'a self, setup: &'a PlanSetup) -> Option<SecondPlayer<'a>> {
        let (Some(doses), Some([moving, still])) = (&self.errors, &setup.parts) else { return None };
        Some(SecondPlayer { doses, moving, still, all: &setup.goals })
    }
}
