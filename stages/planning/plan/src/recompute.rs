//! The dose of a plan on a grid of its own, of which its figures are.
//!
//! An optimiser drives the doses of the points that it samples to what is wanted, and leaves what lies between them. So the
//! figures of a plan are never of those points: its dose is computed again, on a finer grid that does not lie on them.

use std::num::NonZeroUsize;

use crate::dose::{BeamAngles, DoseEngine, DoseError, DoseParams, EngineName, Machine};
use crate::occupancy::Occupancy;
use crate::threads::on_threads;
use stillpoint_patient::Grid;
use stillpoint_patient::case::{Case, Role, Structure};
use stillpoint_patient::couch::Motion;

/// Coarsest spacing of the grid, mm.
const COARSEST_MM: f64 = 2.0;
/// The same of a superposition, which costs more for each voxel.
const COARSEST_SUPERPOSITION_MM: f64 = 3.0;
/// Spacing over that of the points of the optimiser: finer, and on other places.
const FINER: f64 = 0.8;
/// Most voxels of the grid.
const MOST_VOXELS: f64 = 1.2e7;
/// Most beams at a time: each holds a dose.
const MOST_THREADS: NonZeroUsize = NonZeroUsize::MIN.saturating_add(3);

/// The engine of the dose of which figures are.
#[derive(Clone, Debug)]
pub struct Recompute {
    engine: DoseEngine,
}

/// A beam with the weights of its bixels, in the order of the engine's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WeightedBeam<'a> {
    /// Where it comes from.
    pub angles: BeamAngles,
    /// By bixel.
    pub weights: &'a [f64],
    /// Centres of the bixels, mm, where they are others than the engine's.
    pub bixels_mm: Option<&'a [[f64; 2]]>,
}

/// The fluence of a beam on bixels of its own.
#[derive(Clone, Debug, PartialEq)]
pub struct BeamFluence {
    /// Where it comes from.
    pub angles: BeamAngles,
    /// Centres of the bixels, mm.
    pub bixels_mm: Vec<[f64; 2]>,
    /// Their weights, of all fractions.
    pub weights: Vec<f64>,
}

impl BeamFluence {
    /// Beams as the engine takes them.
    pub fn weighted(beams: &[Self]) -> Vec<WeightedBeam<'_>> {
        let mut weighted = Vec::with_capacity(beams.len());
        for Self { angles, bixels_mm, weights } in beams {
            weighted.push(WeightedBeam { angles: *angles, weights, bixels_mm: Some(bixels_mm) });
        }
        weighted
    }
}

impl Recompute {
    /// For a plan whose points are `optimised_mm` apart at the closest: 2 mm, or four fifths of that where it is finer (3 mm by superposition). Above
    /// 12 million voxels the grid is coarser.
    pub fn new(
        case: &Case,
        machine: Machine,
        params: &DoseParams,
        optimised_mm: f64,
    ) -> Result<Self, DoseError> {
        let spacing_mm = match params.engine {
            EngineName::Pencil => COARSEST_MM.min(FINER * optimised_mm),
            EngineName::Superposition => COARSEST_SUPERPOSITION_MM,
        };
        Self::with_spacing(case, machine, params, spacing_mm)
    }

    /// With voxels of this width, mm, around the patient.
    pub fn with_spacing(
        case: &Case,
        machine: Machine,
        params: &DoseParams,
        spacing_mm: f64,
    ) -> Result<Self, DoseError> {
        let external = &case.external().ok_or(DoseError::NoOutline)?.mask;
        if external.is_empty() {
            return Err(DoseError::NoPatient);
        }
        // Structures that leave the outline are judged over all of their voxels.
        let judged = |s: &&Structure| !matches!(s.role, Role::External | Role::Other);
        let mut all = external.clone();
        for structure in case.structures().iter().filter(judged) {
            structure.mask.indices().for_each(|voxel| all.insert(voxel));
        }
        let grid = around(case.grid(), &all, spacing_mm).ok_or(DoseError::NoPatient)?;
        let engine = DoseEngine::of_case(case, machine, DoseParams { grid, ..*params })?;
        // At the border of the patient too, so that there is a dose between there and the first voxel inside.
        let touched = Occupancy::of(&grid, case.grid(), external).voxels();
        Ok(Self { engine: engine.reaching(touched) })
    }

    /// Where its voxels are.
    pub fn grid(&self) -> &Grid {
        &self.engine.params().grid
    }

    /// Dose of the beams, gray, to the patient moved by `shift_mm` along the axes of his frame. Any number of threads gives
    /// the same bytes.
    pub fn dose(
        &self,
        beams: &[WeightedBeam<'_>],
        shift_mm: [f64; 3],
        threads: NonZeroUsize,
    ) -> Result<Vec<f32>, DoseError> {
        let moved;
        let engine = if shift_mm == [0.0; 3] {
            &self.engine
        } else {
            moved = self.engine.shifted(shift_mm)?;
            &moved
        };
        self.sum(beams, threads, |beam| match beam.bixels_mm {
            None => engine.weighted_beam(beam.angles, beam.weights),
            Some(bixels_mm) => engine.weighted_bixels(beam.angles, bixels_mm, beam.weights),
        })
    }

    /// Dose of the beams, gray, to the patient moved like this in his frame, turns included. Beams without bixels of their
    /// own have none. Any number of threads gives the same bytes.
    pub fn moved_dose(
        &self,
        beams: &[WeightedBeam<'_>],
        motion: &Motion,
        threads: NonZeroUsize,
    ) -> Result<Vec<f32>, DoseError> {
        self.sum(beams, threads, |beam| {
            let bixels_mm = beam.bixels_mm.unwrap_or_default();
            self.engine.moved_bixels(beam.angles, bixels_mm, beam.weights, motion)
        })
    }

    /// Part of each of these bixels (centres in mm) whose rays do not cross the patient, moved by `shift_mm` along the axes of
    /// his frame.
    ///
    /// # Errors
    /// An angle out of range.
    pub fn parts_outside(
        &self,
        angles: BeamAngles,
        bixels_mm: &[[f64; 2]],
        shift_mm: [f64; 3],
    ) -> Result<Vec<f64>, DoseError> {
        self.engine.shifted(shift_mm)?.parts_outside(angles, bixels_mm)
    }

    fn sum(
        &self,
        beams: &[WeightedBeam<'_>],
        threads: NonZeroUsize,
        dose: impl Fn(&WeightedBeam<'_>) -> Result<Vec<f32>, DoseError> + Sync,
    ) -> Result<Vec<f32>, DoseError> {
        let threads = threads.min(MOST_THREADS);
        let mut sum = vec![0.0_f32; self.grid().len()];
        // By as many beams as there may be threads, so that the order of the sum is that of the beams and few are held.
        for some in beams.chunks(threads.get()) {
            for dose in on_threads(some, threads, &dose)? {
                sum.iter_mut().zip(&dose).for_each(|(sum, dose)| *sum += dose);
            }
        }
        Ok(sum)
    }
}

/// The grid of this spacing over the voxels of a mask; coarser where it would be too large. `None` where the mask is empty.
fn around(image: &Grid, mask: &stillpoint_patient::case::Mask, spacing_mm: f64) -> Option<Grid> {
    let mut extent = [[usize::MAX, 0]; 3];
    for voxel in mask.indices() {
        for (range, place) in extent.iter_mut().zip(image.voxel(voxel)) {
            *range = [range[0].min(place), range[1].max(place)];
        }
    }
    if extent[0][0] > extent[0][1] {
        return None;
    }
    let low = |axis: usize| image.origin_mm[axis] + (extent[axis][0] as f64 - 0.5) * image.spacing_mm[axis];
    let size = |axis: usize| (extent[axis][1] - extent[axis][0] + 1) as f64 * image.spacing_mm[axis];
    let volume_mm3: f64 = (0..3).map(size).product();
    let spacing = spacing_mm.max(libm::cbrt(volume_mm3 / MOST_VOXELS));
    let counts: [usize; 3] = std::array::from_fn(|axis| (size(axis) / spacing).ceil() as usize);
    let origin = |axis: usize| low(axis) + 0.5 * (size(axis) - (counts[axis] as f64 - 1.0) * spacing);
    Some(Grid { counts, spacing_mm: [spacing; 3], origin_mm: std::array::from_fn(origin) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dose::BixelSpec;
    use stillpoint_patient::case::phantom;

    fn ready(spacing_mm: f64) -> (Case, DoseParams, Recompute) {
        let case = phantom(0).unwrap();
        let params = DoseParams { bixels: BixelSpec::of_width(20.0), ..DoseParams::over(case.grid(), 8.0) };
        let recompute =
            Recompute::with_spacing(&case, Machine::shipped().unwrap(), &params, spacing_mm).unwrap();
        (case, params, recompute)
    }

    #[test]
    fn it_is_the_dose_of_the_matrix_on_the_same_grid() {
        let (_, _, recompute) = ready(6.0);
        for (angle, shift) in [(0.0, [0.0; 3]), (72.0, [0.0; 3]), (200.0, [3.0, -5.0, 4.0])] {
            let engine = recompute.engine.shifted(shift).unwrap();
            let beam = engine.beam(angle).unwrap();
            let weights: Vec<f64> = (0..beam.bixels_mm.len()).map(|i| ((i * 7) % 5) as f64).collect();
            let mut expected = vec![0.0_f64; recompute.grid().len()];
            for (j, weight) in weights.iter().enumerate() {
                let (rows, values) = beam.dose.view().column(j);
                rows.iter().zip(values).for_each(|(r, v)| expected[*r as usize] += weight * f64::from(*v));
            }
            let beams = [WeightedBeam { angles: angle.into(), weights: &weights, bixels_mm: None }];
            let found = recompute.dose(&beams, shift, NonZeroUsize::MIN).unwrap();
            let largest = expected.iter().fold(0.0, |a, b| f64::max(a, *b));
            let off = found.iter().zip(&expected).map(|(f, e)| (f64::from(*f) - e).abs()).fold(0.0, f64::max);
            assert!(largest > 1.0 && off < 2e-3 * largest, "{angle}: {off} of {largest}");
            let squares = found.iter().zip(&expected).map(|(f, e)| (f64::from(*f) - e).powi(2)).sum::<f64>();
            let lit = expected.iter().filter(|dose| **dose > 0.1 * largest).count() as f64;
            assert!((squares / lit).sqrt() < 5e-4 * largest, "{angle}: {squares} in {lit}");
        }
    }

    #[test]
    fn any_number_of_threads_gives_the_same_bytes_and_wrong_weights_are_refused() {
        let (_, _, recompute) = ready(8.0);
        let weights: Vec<Vec<f64>> = [0.0, 40.0, 80.0, 120.0, 160.0]
            .map(|angle| vec![1.5; recompute.engine.beam(angle).unwrap().bixels_mm.len()])
            .to_vec();
        let beams: Vec<WeightedBeam<'_>> = weights
            .iter()
            .enumerate()
            .map(|(i, weights)| WeightedBeam { angles: (40.0 * i as f64).into(), weights, bixels_mm: None })
            .collect();
        let dose =
            |threads: usize| recompute.dose(&beams, [0.0; 3], NonZeroUsize::new(threads).unwrap()).unwrap();
        assert_eq!(dose(1), dose(3));
        let wrong = [WeightedBeam { angles: 0.0.into(), weights: &[1.0], bixels_mm: None }];
        let fault = recompute.dose(&wrong, [0.0; 3], NonZeroUsize::MIN).unwrap_err();
        assert!(matches!(fault, DoseError::Weights { found: 1, .. }), "{fault}");
    }

    #[test]
    fn the_grid_is_finer_than_the_points_covers_the_patient_and_is_bounded() {
        let (case, params, _) = ready(8.0);
        let machine = Machine::shipped().unwrap();
        let spacing = |points_mm| {
            Recompute::new(&case, machine.clone(), &params, points_mm).unwrap().grid().spacing_mm[0]
        };
        assert_eq!((spacing(5.0), spacing(2.0)), (2.0, 1.6));
        let body = &case.external().unwrap().mask;
        let grid = around(case.grid(), body, 0.01).unwrap();
        assert!(grid.len() < 13_500_000 && grid.spacing_mm[0] > 0.1, "{grid:?}");
        let volume: f64 = {
            let grid = around(case.grid(), body, 4.0).unwrap();
            let parts = Occupancy::of(&grid, case.grid(), body);
            parts.histogram(&grid, &vec![0.0; grid.len()]).unwrap().volume()
        };
        assert!((volume - case.volume_cm3(case.external().unwrap())).abs() < 1e-6, "all of the patient");
    }
}
