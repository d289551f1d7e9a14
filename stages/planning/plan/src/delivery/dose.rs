//! The dose over bins of motion.

use std::num::NonZeroUsize;

use super::bins::Bin;
use crate::dose::DoseError;
use crate::recompute::{Recompute, WeightedBeam};
use stillpoint_patient::Grid;

/// Mean dose of a plan over bins, gray, in the patient's own voxels. `each` hears of every bin that is done. Beams need
/// bixels of their own.
pub fn mean_dose(
    recompute: &Recompute,
    beams: &[WeightedBeam<'_>],
    isocentre_mm: [f64; 3],
    bins: &[Bin],
    threads: NonZeroUsize,
    mut each: impl FnMut(),
) -> Result<Vec<f32>, DoseError> {
    let mut mean = vec![0.0_f64; recompute.grid().len()];
    for bin in bins {
        let dose = recompute.moved_dose(beams, &bin.motion(isocentre_mm), threads)?;
        mean.iter_mut().zip(&dose).for_each(|(mean, dose)| *mean += bin.share * f64::from(*dose));
        each();
    }
    Ok(mean.into_iter().map(|gray| gray as f32).collect())
}

/// What the approximation of a dose that stands still in the room gives: the planned dose (gray), at the places to which
/// the shifts of the bins take the voxels. It knows no turns, and not that depths change with the patient.
pub fn shifted_cloud(grid: &Grid, planned: &[f32], bins: &[Bin]) -> Vec<f32> {
    let at = |voxel: usize| {
        let place = grid.centre_mm(grid.voxel(voxel));
        let of_bin = |bin: &Bin| {
            let moved = std::array::from_fn(|axis| place[axis] + bin.shift_mm[axis]);
            bin.share * f64::from(grid.value_at(planned, moved))
        };
        bins.iter().map(of_bin).sum::<f64>() as f32
    };
    (0..grid.len()).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dose::{BixelSpec, DoseEngine, DoseParams, Machine};
    use crate::recompute::BeamFluence;
    use stillpoint_patient::case::{Case, phantom};

    const STILL: Bin = Bin { share: 1.0, shift_mm: [0.0; 3], turn_rad: [0.0; 3] };

    struct Ready {
        case: Case,
        engine: DoseEngine,
        recompute: Recompute,
    }

    fn ready() -> Ready {
        let case = phantom(0).unwrap();
        let params = DoseParams { bixels: BixelSpec::of_width(20.0), ..DoseParams::over(case.grid(), 8.0) };
        let machine = Machine::shipped().unwrap();
        let recompute = Recompute::with_spacing(&case, machine.clone(), &params, 6.0).unwrap();
        Ready { engine: DoseEngine::of_case(&case, machine, params).unwrap(), case, recompute }
    }

    /// An uneven fluence: no turn or mirror of it is itself.
    fn fluence(ready: &Ready, gantry_deg: f64) -> BeamFluence {
        let bixels_mm = ready.engine.beam(gantry_deg).unwrap().bixels_mm;
        let weight = |[x, z]: &[f64; 2]| 3.0 + 0.03 * x + 0.02 * z;
        let weights = bixels_mm.iter().map(weight).collect();
        BeamFluence { angles: gantry_deg.into(), bixels_mm, weights }
    }

    fn delivered(ready: &Ready, beams: &[BeamFluence], bins: &[Bin]) -> Vec<f32> {
        let (beams, isocentre_mm) = (BeamFluence::weighted(beams), ready.case.isocentre_mm());
        mean_dose(&ready.recompute, &beams, isocentre_mm, bins, NonZeroUsize::MIN, || ()).unwrap()
    }

    /// Largest difference as a part of the largest dose, and the root mean square of it where there is dose.
    fn difference(a: &[f32], b: &[f32]) -> [f64; 2] {
        let largest = f64::from(b.iter().fold(0.0, |x, y| f32::max(x, *y)));
        let off = || a.iter().zip(b).map(|(a, b)| f64::from(a - b) / largest);
        let lit = b.iter().filter(|gray| f64::from(**gray) > 0.1 * largest).count() as f64;
        [
            off().map(f64::abs).fold(0.0, f64::max),
            libm::sqrt(off().map(|part| part * part).sum::<f64>() / lit),
        ]
    }

    #[test]
    fn a_patient_who_lies_still_gets_the_planned_dose_and_a_shifted_one_that_of_the_shifted_set_up() {
        let ready = ready();
        let beams = [fluence(&ready, 40.0)];
        let planned = |shift| {
            let beams = BeamFluence::weighted(&beams);
            ready.recompute.dose(&beams, shift, NonZeroUsize::MIN).unwrap()
        };
        let [worst, _] = difference(&delivered(&ready, &beams, &[STILL]), &planned([0.0; 3]));
        assert!(worst < 1e-4, "{worst}");

        let shift_mm = [6.0, -4.0, 9.0];
        let moved = Bin { shift_mm, ..STILL };
        let found = delivered(&ready, &beams, &[moved]);
        let [worst, _] = difference(&found, &planned(shift_mm));
        let [still, _] = difference(&found, &planned([0.0; 3]));
        assert!(worst < 1e-4 && still > 0.3, "{worst}, {still} without the shift");

        let halves = [Bin { share: 0.5, ..STILL }, Bin { share: 0.5, ..moved }];
        let mean: Vec<f32> =
            planned([0.0; 3]).iter().zip(planned(shift_mm)).map(|(a, b)| 0.5 * (a + b)).collect();
        let [worst, _] = difference(&delivered(&ready, &beams, &halves), &mean);
        assert!(worst < 1e-4, "{worst}");

        // The dose that stands still in the room is near to it deep inside, and not the same.
        let cloud = shifted_cloud(ready.recompute.grid(), &planned([0.0; 3]), &[moved]);
        let [_, near] = difference(&cloud, &planned(shift_mm));
        let [_, far] = difference(&cloud, &planned([0.0; 3]));
        assert!(near > 1e-3 && near < 0.5 * far, "{near} {far}");
    }

    #[test]
    fn a_turn_about_the_long_axis_is_a_turn_of_the_gantry_the_other_way() {
        // Points p of a patient who turned by a are seen by the gantry angle g as those of one who lies still are by g - a:
        // R(-g) R(a) = R(-(g - a)).
        let ready = ready();
        let beam = fluence(&ready, 50.0);
        let turned = Bin { turn_rad: [0.0, 0.0, 30.0_f64.to_radians()], ..STILL };
        let dose = |gantry_deg, bin| {
            delivered(&ready, &[BeamFluence { angles: f64::into(gantry_deg), ..beam.clone() }], &[bin])
        };
        let found = dose(50.0, turned);
        let [worst, rms] = difference(&found, &dose(20.0, STILL));
        let [_, other_way] = difference(&found, &dose(80.0, STILL));
        assert!(rms < 2e-3 && worst < 0.02 && other_way > 0.05, "{rms} {worst} {other_way}");
    }

    #[test]
    fn turns_about_the_axis_of_a_beam_turn_its_fluence_the_other_way() {
        // The beam of gantry angle 0 runs along y. A turn by 90 degrees takes (x, z) to (z, -x), so the fluence that a voxel
        // meets is that of a still patient whose bixels were turned back: (x, z) to (-z, x).
        let ready = ready();
        let beam = fluence(&ready, 0.0);
        let turned = |degrees: f64| Bin { turn_rad: [0.0, degrees.to_radians(), 0.0], ..STILL };
        let dose = |bixels_mm, bin| delivered(&ready, &[BeamFluence { bixels_mm, ..beam.clone() }], &[bin]);
        let back = |quarters: usize| -> Vec<[f64; 2]> {
            let turn = |place: &[f64; 2]| (0..quarters).fold(*place, |[x, z], _| [-z, x]);
            beam.bixels_mm.iter().map(turn).collect()
        };
        for (degrees, quarters) in [(90.0, 1), (180.0, 2)] {
            let found = dose(beam.bixels_mm.clone(), turned(degrees));
            let [worst, rms] = difference(&found, &dose(back(quarters), STILL));
            let [_, other_way] = difference(&found, &dose(back(quarters + 2), STILL));
            assert!(rms < 2e-3 && worst < 0.02 && other_way > 0.05, "{degrees}: {rms} {worst} {other_way}");
        }
    }

    #[test]
    fn a_patient_behind_the_source_is_refused() {
        let ready = ready();
        let beams = [fluence(&ready, 0.0)];
        let far = Bin { shift_mm: [0.0, -900.0, 0.0], ..STILL };
        let (beams, isocentre_mm) = (BeamFluence::weighted(&beams), ready.case.isocentre_mm());
        let dose = mean_dose(&ready.recompute, &beams, isocentre_mm, &[far], NonZeroUsize::MIN, || ());
        assert!(matches!(dose, Err(DoseError::Far { .. })), "{dose:?}");
    }
}
