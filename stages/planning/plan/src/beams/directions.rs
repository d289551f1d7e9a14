//! Where the beams of a search come from: the angles behind their numbers.

use std::sync::Arc;

use super::ring::{BeamSet, Ring, RingError};
use crate::dose::BeamAngles;

/// Angles that differ by no more are the same, degrees: half of a hundredth, and what its sums round to.
const SAME_DEG: f64 = 0.005 + 1e-9;

/// The angles of numbered beams: those of a ring around the patient with the couch at 0 degrees, or those of a list with any
/// angles of gantry and couch.
#[derive(Clone, Debug, PartialEq)]
pub struct Directions {
    ring: Ring,
    /// By number of the beam; nothing where the ring has the angles.
    listed: Option<Arc<[BeamAngles]>>,
}

impl From<Ring> for Directions {
    fn from(ring: Ring) -> Self {
        Self { ring, listed: None }
    }
}

impl Directions {
    /// Those of beams with these angles, in any order: by the ring where it holds all of them, as [`Ring::for_angles`] has it,
    /// otherwise by a list. Angles are taken to the nearest hundredth of a degree.
    ///
    /// # Errors
    /// An angle is not finite, or two beams have the same angles.
    pub fn for_angles(ring: Ring, angles: &[BeamAngles]) -> Result<Self, RingError> {
        if let Some(wrong) = angles.iter().find(|angles| !angles.is_finite()) {
            return Err(RingError::Angle(wrong.to_string()));
        }
        if angles.iter().all(|angles| angles.wrapped().is_coplanar()) {
            let gantry: Vec<f64> = angles.iter().map(|angles| angles.gantry_deg).collect();
            return Ok(ring.for_angles(&gantry)?.into());
        }
        Self::listed(angles)
    }

    /// Those of a list of beams, which are numbered by rising gantry and then couch angle. Beams of a set need only differ.
    ///
    /// # Errors
    /// The list is empty, an angle is not finite, or two beams have the same angles.
    pub fn listed(angles: &[BeamAngles]) -> Result<Self, RingError> {
        let mut listed: Vec<BeamAngles> = angles.iter().copied().map(rounded).collect();
        listed
            .sort_by(|a, b| a.gantry_deg.total_cmp(&b.gantry_deg).then(a.couch_deg.total_cmp(&b.couch_deg)));
        if let Some(twice) = listed.windows(2).find(|pair| pair[0] == pair[1]) {
            return Err(RingError::Twice(twice[0].to_string()));
        }
        if let Some(wrong) = listed.iter().find(|angles| !angles.is_finite()) {
            return Err(RingError::Angle(wrong.to_string()));
        }
        let count = u16::try_from(listed.len()).map_err(|_| RingError::Many(listed.len()))?;
        Ok(Self { ring: Ring::new(count, 1)?, listed: Some(listed.into()) })
    }

    /// The ring on which sets of these beams are. Of a list, it numbers the beams and means no angles.
    pub fn ring(&self) -> Ring {
        self.ring
    }

    /// The angles of a beam; the gantry's in [0, 360) and the couch's in (-180, 180] degrees.
    pub fn angles(&self, beam: u16) -> BeamAngles {
        match &self.listed {
            Some(listed) => listed.get(usize::from(beam)).copied().unwrap_or_default(),
            None => self.ring.angle_deg(beam).into(),
        }
    }

    /// The angles of these beams.
    pub fn all(&self, beams: &[u16]) -> Vec<BeamAngles> {
        beams.iter().map(|beam| self.angles(*beam)).collect()
    }

    /// The couch angles of these beams, degrees; none where all are 0.
    pub fn couches_deg(&self, beams: &[u16]) -> Vec<f64> {
        let couches: Vec<f64> = self.all(beams).iter().map(|angles| angles.couch_deg).collect();
        if couches.iter().all(|deg| *deg == 0.0) { Vec::new() } else { couches }
    }

    /// The beam with these angles, if there is one.
    pub fn beam(&self, angles: BeamAngles) -> Option<u16> {
        if !angles.is_finite() {
            return None;
        }
        let near = |a: f64, b: f64| {
            let off = (a - b).rem_euclid(360.0);
            off.min(360.0 - off) <= SAME_DEG
        };
        let is_same = |found: BeamAngles| {
            near(found.gantry_deg, angles.gantry_deg) && near(found.couch_deg, angles.couch_deg)
        };
        match &self.listed {
            Some(listed) => {
                listed.iter().position(|found| is_same(*found)).and_then(|at| u16::try_from(at).ok())
            }
            None => Some(self.ring.nearest(angles.gantry_deg)).filter(|beam| is_same(self.angles(*beam))),
        }
    }

    /// Degrees between two angles of the ring; `None` of a list.
    pub fn step_deg(&self) -> Option<f64> {
        self.listed.is_none().then(|| self.ring.step_deg())
    }

    /// The set of these beams, in any order.
    ///
    /// # Errors
    /// The ring has no such set.
    pub fn set(&self, beams: &[u16]) -> Result<BeamSet, RingError> {
        self.ring.set(beams)
    }

    /// The set of the beams with these angles, in any order.
    ///
    /// # Errors
    /// A beam is not among the directions, or the ring has no such set.
    pub fn set_of(&self, angles: &[BeamAngles]) -> Result<BeamSet, RingError> {
        let beam =
            |angles: &BeamAngles| self.beam(*angles).ok_or_else(|| RingError::Unlisted(angles.to_string()));
        self.set(&angles.iter().map(beam).collect::<Result<Vec<u16>, _>>()?)
    }
}

/// To hundredths of a degree, wrapped.
fn rounded(angles: BeamAngles) -> BeamAngles {
    let hundredths = |deg: f64| (deg * 100.0).round() / 100.0;
    let BeamAngles { gantry_deg, couch_deg } = angles.wrapped();
    // Zeros lose their sign, so that equal angles are equal bits.
    BeamAngles { gantry_deg: hundredths(gantry_deg) % 360.0 + 0.0, couch_deg: hundredths(couch_deg) + 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn angles(pairs: &[[f64; 2]]) -> Vec<BeamAngles> {
        pairs.iter().map(|pair| (*pair).into()).collect()
    }

    #[test]
    fn coplanar_beams_stay_on_their_ring() {
        let ring = Ring::new(90, 5).unwrap();
        let of = |pairs: &[[f64; 2]]| Directions::for_angles(ring, &angles(pairs)).unwrap();
        assert_eq!(of(&[[0.0, 0.0], [72.0, 0.0]]), ring.into());
        assert_eq!(of(&[[0.0, 360.0], [-288.0, 0.0]]), ring.into());
        assert_eq!(of(&[[0.0, 0.0], [13.37, 0.0]]), ring.for_angles(&[0.0, 13.37]).unwrap().into());
    }

    #[test]
    fn listed_beams_are_numbered_by_gantry_and_couch() {
        let ring = Ring::new(90, 5).unwrap();
        let of = |pairs: &[[f64; 2]]| Directions::for_angles(ring, &angles(pairs));
        let three = of(&[[72.0, 30.0], [0.0, 0.0], [72.0, 330.0]]).unwrap();
        assert_eq!(three.all(&[0, 1, 2]), angles(&[[0.0, 0.0], [72.0, -30.0], [72.0, 30.0]]));
        assert_eq!(three.beam([432.0, 30.001].into()), Some(2));
        assert_eq!(three.beam([72.0, 0.0].into()), None);
        assert_eq!(three.set_of(&angles(&[[72.0, 30.0], [0.0, 0.0]])).unwrap().beams(), [0, 2]);
        assert_eq!(three.set_of(&angles(&[[1.0, 0.0]])), Err(RingError::Unlisted("1".to_owned())));
        // Angles between two hundredths are those that they were rounded to.
        for thousandths in (5..36_000).step_by(10) {
            let between = f64::from(thousandths) / 1000.0;
            let two = of(&[[between, 30.0], [200.0, 0.0]]).unwrap();
            assert!(two.beam([between, 30.0].into()).is_some(), "{between}");
            let flat = of(&[[between, 0.0], [200.0, 0.0]]).unwrap();
            assert!(flat.beam([between, 0.0].into()).is_some(), "{between}");
        }
        assert_eq!(three.set(&[2, 0]).unwrap().beams(), [0, 2]);
        assert!(matches!(of(&[[72.0, 30.0], [432.0, 390.0]]), Err(RingError::Twice(_))));
        assert!(matches!(of(&[[72.0, f64::NAN]]), Err(RingError::Angle(_))));
        assert!(matches!(Directions::listed(&[]), Err(RingError::NoAngle)));
    }
}
