//! Doses of beams that are computed when a search first asks for them.
//!
//! A search with couch angles has hundreds of candidates, and a dose of each would be most of its work. So beams are priced in two
//! steps. All candidates are priced on a sample of the points, for which a dose is cheap. The exact doses of the dearest few are
//! computed, and those are priced on all points.

use std::num::NonZeroUsize;
use std::sync::{Mutex, OnceLock, PoisonError};

use super::directions::Directions;
use super::evaluator::{Evaluated, Influence};
use super::price::{Slopes, promise};
use super::solver::slopes_at;
use crate::Setups;
use crate::dose::{BeamFile, CacheError, CachedBeam, DoseCache, DoseEngine};
use crate::fluence::Goals;
use crate::threads::on_threads;

/// One point in so many is in the sample.
const STRIDE: usize = 6;
/// Candidates that are priced on all points.
const SHORT: usize = 8;
/// Least angle between a candidate and the beams that stay, degrees.
const APART_DEG: f64 = 20.0;

/// The doses of beams of a list of directions, of which each is computed once, or found in a folder.
pub struct LazyDoses<'a> {
    directions: &'a Directions,
    goals: &'a Goals,
    /// For each set-up of the patient.
    engines: &'a [DoseEngine],
    /// The same for the sample of the points.
    sampled: Vec<DoseEngine>,
    cache: &'a DoseCache,
    threads: NonZeroUsize,
    whole: Vec<OnceLock<Vec<BeamFile>>>,
    coarse: Vec<OnceLock<Vec<BeamFile>>>,
    fault: Mutex<Option<CacheError>>,
}

impl<'a> LazyDoses<'a> {
    /// For engines of which each is a set-up of the patient, and their goals.
    pub fn new(
        directions: &'a Directions,
        goals: &'a Goals,
        engines: &'a [DoseEngine],
        cache: &'a DoseCache,
        threads: NonZeroUsize,
    ) -> Self {
        let sampled = engines.iter().map(|engine| {
            let rows = engine.rows() as u32;
            let in_first = goals.voxels().iter().copied().filter(|row| *row < rows);
            engine.within(&in_first.step_by(STRIDE).collect::<Vec<u32>>())
        });
        let slots = || (0..directions.ring().count()).map(|_| OnceLock::new()).collect();
        Self {
            directions,
            goals,
            sampled: sampled.collect(),
            engines,
            cache,
            threads,
            whole: slots(),
            coarse: slots(),
            fault: Mutex::new(None),
        }
    }

    /// Beams whose doses at all points were needed.
    pub fn needed(&self) -> usize {
        self.whole.iter().filter(|slot| slot.get().is_some_and(|doses| !doses.is_empty())).count()
    }

    /// The first fault of a dose, if there was one: the beam then has no dose and no search can use it.
    ///
    /// # Errors
    /// That fault.
    pub fn check(self) -> Result<(), CacheError> {
        match self.fault.into_inner().unwrap_or_else(PoisonError::into_inner) {
            Some(fault) => Err(fault),
            None => Ok(()),
        }
    }

    fn whole(&self, beam: u16) -> &[BeamFile] {
        self.of(&self.whole, beam, |angles| {
            self.engines.iter().map(|engine| Ok(self.cache.beam(engine, angles)?.beam)).collect()
        })
    }

    fn coarse(&self, beam: u16) -> &[BeamFile] {
        self.of(&self.coarse, beam, |angles| {
            self.sampled.iter().map(|engine| Ok(CachedBeam::computed(engine, angles)?.beam)).collect()
        })
    }

    fn of<'b>(
        &self,
        slots: &'b [OnceLock<Vec<BeamFile>>],
        beam: u16,
        doses: impl FnOnce(crate::dose::BeamAngles) -> Result<Vec<BeamFile>, CacheError>,
    ) -> &'b [BeamFile] {
        let Some(slot) = slots.get(usize::from(beam)) else { return &[] };
        slot.get_or_init(|| match doses(self.directions.angles(beam)) {
            Ok(doses) => doses,
            Err(fault) => {
                self.fault.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(fault);
                Vec::new()
            }
        })
    }
}

fn setups(doses: &[BeamFile]) -> Setups<'_> {
    let all = Setups::new(doses.iter().map(BeamFile::dose).collect()).unwrap_or_default();
    all.placed(doses.first().map_or(&[], BeamFile::bixels_mm))
}

impl Influence for LazyDoses<'_> {
    fn beam(&self, beam: u16) -> Setups<'_> {
        setups(self.whole(beam))
    }

    /// Those at least 20 degrees from the beams of the base that promise most on the sample of the points.
    fn shortlist(&self, base: Option<&Evaluated>, candidates: &[u16]) -> Option<Vec<u16>> {
        let slopes: Slopes = slopes_at(self.goals, base.map(|base| &base.plan)).ok()?;
        let stay = self.directions.all(base.map_or(&[], |base| base.beams.beams()));
        let is_apart = |beam: &u16| {
            let angles = self.directions.angles(*beam);
            stay.iter().all(|other| other.apart_deg(&angles) >= APART_DEG)
        };
        let apart: Vec<u16> = candidates.iter().copied().filter(is_apart).collect();
        let price = |beam: &u16| {
            let doses = setups(self.coarse(*beam));
            Ok::<f64, CacheError>(if doses.rows() == 0 { 0.0 } else { promise(&doses, &slopes) })
        };
        let prices = on_threads(&apart, self.threads, price).ok()?;
        let mut order: Vec<usize> = (0..apart.len()).collect();
        order.sort_by(|a, b| prices[*b].total_cmp(&prices[*a]));
        Some(order.into_iter().take(SHORT).map(|at| apart[at]).collect())
    }
}
