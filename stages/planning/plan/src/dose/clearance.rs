//! Where gantry and couch have room: ranges of angles at which they do not collide.

use serde::{Deserialize, Serialize};

use super::angles::BeamAngles;
use super::machine::{MachineError, in_range, size};

/// A range of couch angles with the gantry angles that are free there.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FreeRange {
    /// Least and greatest couch angle, degrees from -180 to 180.
    pub couch_deg: [f64; 2],
    /// First and last gantry angle, degrees from 0 to 360, upward; a first angle above the last one passes 0.
    pub gantry_deg: [f64; 2],
}

impl FreeRange {
    /// The ranges of a machine that does not state its own: a choice of this project, not of any product.
    ///
    /// A couch that is turned by a positive angle has its foot end on the side of gantry 90 degrees, and its head end on that of
    /// 270. There the gantry may pass down to 30 degrees below the horizontal; on the side of the foot end it stays above the
    /// patient. With a couch that is hardly turned the gantry is free.
    pub fn generic() -> Vec<Self> {
        let of = |couch_deg, gantry_deg| Self { couch_deg, gantry_deg };
        vec![
            of([-5.0, 5.0], [0.0, 360.0]),
            of([5.0, 45.0], [240.0, 50.0]),
            of([45.0, 90.0], [240.0, 20.0]),
            of([-45.0, -5.0], [310.0, 120.0]),
            of([-90.0, -45.0], [340.0, 120.0]),
        ]
    }

    /// Whether these angles are in the range, its ends included.
    pub fn holds(&self, angles: BeamAngles) -> bool {
        let BeamAngles { gantry_deg, couch_deg } = angles.wrapped();
        let [first, last] = self.gantry_deg;
        let is_between = match first <= last {
            true => (first..=last).contains(&gantry_deg),
            false => gantry_deg >= first || gantry_deg <= last,
        };
        is_between && (self.couch_deg[0]..=self.couch_deg[1]).contains(&couch_deg)
    }

    pub(super) fn check(ranges: &[Self]) -> Result<(), MachineError> {
        size("free_angles", ranges.len(), 1..=1000)?;
        for range in ranges {
            for deg in range.couch_deg {
                in_range("free_angles.couch_deg", deg, -180.0..=180.0, "from -180 to 180 degrees")?;
            }
            let rises = range.couch_deg[0]..=180.0;
            in_range("free_angles.couch_deg", range.couch_deg[1], rises, "at least the first one")?;
            for deg in range.gantry_deg {
                in_range("free_angles.gantry_deg", deg, 0.0..=360.0, "from 0 to 360 degrees")?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turned_couch_leaves_room_on_the_side_of_its_head_end() {
        let free = FreeRange::generic();
        let is_free = |angles: [f64; 2]| free.iter().any(|range| range.holds(angles.into()));
        assert!((0..360).all(|gantry| is_free([f64::from(gantry), 0.0])));
        assert!(is_free([270.0, 90.0]) && !is_free([90.0, 90.0]) && !is_free([180.0, 30.0]));
        assert!(is_free([90.0, -90.0]) && !is_free([270.0, -90.0]) && !is_free([0.0, 91.0]));
        // The table is a mirror image of itself.
        for gantry in 0..360 {
            for couch in -90..=90 {
                let angles = [f64::from(gantry), f64::from(couch)];
                assert_eq!(is_free(angles), is_free(angles.map(|deg| -deg)), "{angles:?}");
            }
        }
    }
}
