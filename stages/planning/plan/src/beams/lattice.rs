//! The candidates of a search with couch angles: a lattice of gantry and couch angles that are free of collisions.

use super::directions::Directions;
use super::ring::RingError;
use crate::dose::{BeamAngles, FreeRange};

/// Steps of the lattice, degrees.
const STEP_DEG: i32 = 15;
/// Directions in the patient that are nearer to each other than this count once, degrees.
const SAME_DEG: f64 = 8.0;

/// These beams and the lattice around them: couch angles up to `most_deg` to both sides in steps of 15 degrees, and
/// gantry angles in the same steps, where `free` has them and there is a beam. Of directions that are nearly the same in the
/// patient, that of the smallest couch angle stays; `beams` always stay.
///
/// # Errors
/// Two of `beams` have the same angles, or one is not finite.
pub fn candidates(
    beams: &[BeamAngles],
    most_deg: f64,
    free: &[FreeRange],
    has_beam: impl Fn(BeamAngles) -> bool,
) -> Result<Directions, RingError> {
    let mut all = beams.to_vec();
    let most = (most_deg.min(180.0) / f64::from(STEP_DEG)).floor() as i32;
    for step in 0..=most {
        for side in if step == 0 { [1, 1] } else { [1, -1] } {
            for gantry in (0..360).step_by(STEP_DEG as usize) {
                let angles = BeamAngles::from([f64::from(gantry), f64::from(side * step * STEP_DEG)]);
                let is_free = free.iter().any(|range| range.holds(angles));
                let is_apart = || all.iter().all(|other| other.apart_deg(&angles) >= SAME_DEG);
                if is_free && is_apart() && has_beam(angles) {
                    all.push(angles);
                }
            }
        }
    }
    Directions::listed(&all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn candidates_are_free_apart_and_hold_the_beams_they_begin_with() {
        let beams: Vec<BeamAngles> = [0.0, 72.0, 144.0].map(BeamAngles::from).to_vec();
        let free = FreeRange::generic();
        let found = candidates(&beams, 90.0, &free, |_| true).unwrap();
        let all = found.all(&(0..found.ring().count()).collect::<Vec<_>>());
        assert!(beams.iter().all(|beam| found.beam(*beam).is_some()));
        assert!(all.len() > 80, "{}", all.len());
        assert!(all.iter().all(|angles| free.iter().any(|range| range.holds(*angles))));
        for (at, angles) in all.iter().enumerate() {
            assert!(all[..at].iter().all(|other| other.apart_deg(angles) >= SAME_DEG), "{angles}");
        }
        let flat = candidates(&beams, 0.0, &free, |_| true).unwrap();
        assert!(flat.couches_deg(&(0..flat.ring().count()).collect::<Vec<_>>()).is_empty());
        let within = candidates(&beams, 30.0, &free, |_| true).unwrap();
        assert!(within.ring().count() < found.ring().count() && within.ring().count() > flat.ring().count());
    }
}
