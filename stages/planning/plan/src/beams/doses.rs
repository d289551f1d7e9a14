//! Doses of the beams of a ring, from the cache, for one set-up of the patient or several.

use std::num::NonZeroUsize;

use super::directions::Directions;
use super::evaluator::{Evaluated, Influence};
use super::second::Displaced;
use crate::dose::{
    BeamAngles, BeamFile, BeamFileError, CacheError, CachedBeam, DoseCache, DoseEngine, DoseError, Origin,
};
use crate::threads::on_threads;
use crate::{RowsRef, Setups};

/// Least factor of a row in a correction, and the greatest is its reciprocal: far from a beam, columns have little dose of it.
const LEAST_FACTOR: f32 = 0.125;

/// The doses of some beams of a ring. The other beams have no dose, and no plan can use them.
#[derive(Debug)]
pub struct RingDoses {
    /// For each beam of the ring one dose for each set-up.
    beams: Vec<Vec<CachedBeam>>,
}

impl RingDoses {
    /// The doses of `beams`, by an engine for each set-up, the planned one first. `on_beam` is called for each beam.
    pub fn load(
        cache: &DoseCache,
        engines: &[DoseEngine],
        directions: impl Into<Directions>,
        beams: &[u16],
        threads: NonZeroUsize,
        on_beam: impl Fn() + Sync,
    ) -> Result<Self, CacheError> {
        Self::by(engines, &directions.into(), beams, |engine, angles| {
            cache.beams_with(engine, angles, threads, &on_beam)
        })
    }

    /// The doses of `beams`, computed in memory.
    pub fn compute(
        engines: &[DoseEngine],
        directions: impl Into<Directions>,
        beams: &[u16],
        threads: NonZeroUsize,
    ) -> Result<Self, CacheError> {
        Self::by(engines, &directions.into(), beams, |engine, angles| {
            on_threads(angles, threads, |angles| CachedBeam::computed(engine, *angles))
        })
    }

    fn by(
        engines: &[DoseEngine],
        directions: &Directions,
        beams: &[u16],
        doses: impl Fn(&DoseEngine, &[BeamAngles]) -> Result<Vec<CachedBeam>, CacheError>,
    ) -> Result<Self, CacheError> {
        let angles = directions.all(beams);
        let mut all: Vec<Vec<CachedBeam>> = (0..directions.ring().count()).map(|_| Vec::new()).collect();
        for engine in engines {
            let found = doses(engine, &angles)?;
            for (beam, dose) in beams.iter().zip(found) {
                if let Some(setups) = all.get_mut(usize::from(*beam)) {
                    setups.push(dose);
                }
            }
        }
        Ok(Self { beams: all })
    }

    /// Centres of the bixels of a beam on the isocentre plane, x and z in the beam's frame, mm.
    pub fn bixels_mm(&self, beam: u16) -> &[[f64; 2]] {
        self.setups(beam).first().map_or(&[], |dose| dose.beam.bixels_mm())
    }

    /// Dose of a plan to every voxel of the dose grid in a set-up, gray; 0 in voxels that the set-up leaves out.
    pub fn dose(&self, plan: &Evaluated, setup: usize) -> Vec<f32> {
        let matrices: Vec<_> = plan
            .beams
            .beams()
            .iter()
            .filter_map(|beam| Some((self.setups(*beam).get(setup)?.beam.dose(), plan.weights_of(*beam)?)))
            .collect();
        let voxels = matrices.iter().map(|(dose, _)| dose.rows()).max().unwrap_or_default();
        let of_voxel = |voxel: usize| {
            let of_beam = |(dose, weights): &(crate::RowsRef<'_>, &[f64])| {
                let (columns, values) = dose.row(voxel);
                columns.iter().zip(values).map(|(c, v)| f64::from(*v) * weights[usize::from(*c)]).sum::<f64>()
            };
            matrices.iter().map(of_beam).sum::<f64>() as f32
        };
        (0..voxels).map(of_voxel).collect()
    }

    /// The doses of the beams of a plan with each row times the dose that the engines (one for each set-up) compute of the whole
    /// fluence, over the dose of the columns: at the weights of the plan, the columns give what the engines compute. Factors
    /// are from 1/8 to 8, and a row without dose stays as it is. The other beams have no dose.
    pub(crate) fn corrected(
        &self,
        engines: &[DoseEngine],
        plan: &Evaluated,
        threads: NonZeroUsize,
    ) -> Result<Self, DoseError> {
        let of_setup = |(setup, engine): (usize, &DoseEngine)| {
            let whole = on_threads(plan.beams.beams(), threads, |beam| {
                let weights = plan.weights_of(*beam).unwrap_or_default();
                let Some(dose) = self.setups(*beam).get(setup) else { return Ok(Vec::new()) };
                engine.weighted_bixels(dose.beam.angles(), dose.beam.bixels_mm(), weights)
            })?;
            let mut factors = self.dose(plan, setup);
            for (row, factor) in factors.iter_mut().enumerate() {
                let computed: f32 = whole.iter().filter_map(|dose| dose.get(row)).sum();
                let of_columns = *factor;
                *factor = if of_columns > 0.0 {
                    (computed / of_columns).clamp(LEAST_FACTOR, 1.0 / LEAST_FACTOR)
                } else {
                    1.0
                };
            }
            Ok(factors)
        };
        let factors: Result<Vec<Vec<f32>>, DoseError> = engines.iter().enumerate().map(of_setup).collect();
        let factors = factors?;
        let scaled = |(dose, factors): (&CachedBeam, &Vec<f32>)| CachedBeam {
            beam: dose.beam.scaled(factors),
            origin: Origin::Computed,
        };
        let mut beams: Vec<Vec<CachedBeam>> = self.beams.iter().map(|_| Vec::new()).collect();
        for beam in plan.beams.beams() {
            if let Some(setups) = beams.get_mut(usize::from(*beam)) {
                *setups = self.setups(*beam).iter().zip(&factors).map(scaled).collect();
            }
        }
        Ok(Self { beams })
    }

    /// The dose files of a beam, one for each set-up.
    pub fn files(&self, beam: u16) -> impl Iterator<Item = &BeamFile> {
        self.setups(beam).iter().map(|dose| &dose.beam)
    }

    /// How many doses were computed now, and bytes of all of them.
    pub fn computed(&self) -> (usize, usize) {
        let all = || self.beams.iter().flatten();
        let new = all().filter(|dose| !matches!(dose.origin, Origin::Found)).count();
        (new, all().map(|dose| dose.beam.size()).sum())
    }

    /// What was wrong with files that were there and were replaced.
    pub fn replaced(&self) -> impl Iterator<Item = &BeamFileError> {
        self.beams.iter().flatten().filter_map(|dose| match &dose.origin {
            Origin::Replaced(fault) => Some(fault),
            _ => None,
        })
    }

    fn setups(&self, beam: u16) -> &[CachedBeam] {
        self.beams.get(usize::from(beam)).map_or(&[], Vec::as_slice)
    }
}

impl Influence for RingDoses {
    fn beam(&self, beam: u16) -> Setups<'_> {
        let setups = Setups::new(self.setups(beam).iter().map(|dose| dose.beam.dose()).collect());
        setups.unwrap_or_default().placed(self.bixels_mm(beam))
    }
}

/// Its set-ups are the errors.
impl Displaced for RingDoses {
    fn errors(&self) -> usize {
        self.beams.iter().map(Vec::len).max().unwrap_or(0)
    }

    fn beam(&self, beam: u16, error: usize) -> Option<RowsRef<'_>> {
        self.setups(beam).get(error).map(|dose| dose.beam.dose())
    }
}
