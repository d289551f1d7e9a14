//! The ring of gantry angles, and sets of beams on it (SCIENCE G1).

use thiserror::Error;

/// Equal steps around the gantry's circle, and how far beams must be apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ring {
    count: u16,
    gap: u16,
}

/// Why there is no such ring, or no such set on it.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum RingError {
    /// A ring without angles.
    #[error("a ring has at least one angle")]
    NoAngle,
    /// What is no angle.
    #[error("invalid gantry angle: {0} (allowed: any finite number of degrees)")]
    Angle(String),
    /// Two beams of one angle.
    #[error("two beams have the gantry angle {0} degrees (to 0.01 degrees): give each angle once")]
    Twice(String),
    /// A beam that is not among the directions.
    #[error("no direction has the angles {0} degrees")]
    Unlisted(String),
    /// Too many beams to be numbered.
    #[error("{0} directions of beams are too many (allowed: 65535)")]
    Many(usize),
    /// A plan without beams.
    #[error("a plan has at least one beam")]
    NoBeam,
    /// A place that is not on the ring.
    #[error("angle number {beam} is not on a ring of {count}")]
    Place {
        /// Its number.
        beam: u16,
        /// Angles of the ring.
        count: u16,
    },
    /// Two beams stand too near.
    #[error("angles {a} and {b} of a ring of {count} are nearer than {gap} steps")]
    Near {
        /// The first of the two beams.
        a: u16,
        /// The second of the two beams.
        b: u16,
        /// Angles of the ring.
        count: u16,
        /// Steps that are due.
        gap: u16,
    },
    /// So many beams do not fit.
    #[error("{beams} beams, {gap} steps apart, do not fit on a ring of {count}")]
    Crowded {
        /// Number of beams.
        beams: usize,
        /// Steps between them.
        gap: u16,
        /// Angles of the ring.
        count: u16,
    },
}

/// Angles of the finest ring: steps of 0.01 degrees.
const FINE: u16 = 36_000;

/// Beams by their number on the ring: rising, apart by the ring's gap.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct BeamSet(Vec<u16>);

impl Ring {
    /// `count` angles; beams of a set are at least `gap` steps apart (1: merely different).
    pub fn new(count: u16, gap: u16) -> Result<Self, RingError> {
        if count == 0 { Err(RingError::NoAngle) } else { Ok(Self { count, gap: gap.max(1) }) }
    }

    /// A ring on which beams of these angles (degrees, any number of turns away) can be set: this one, if it holds them, else one
    /// of steps of 0.01 degrees on which beams need only differ. Angles are taken to the nearest hundredth of a degree.
    pub fn for_angles(self, angles_deg: &[f64]) -> Result<Self, RingError> {
        let fine = Self { count: FINE, gap: 1 };
        let numbers = |ring: Self| angles_deg.iter().map(|a| ring.nearest(*a)).collect::<Vec<_>>();
        if let Some(&angle) = angles_deg.iter().find(|a| !a.is_finite()) {
            return Err(RingError::Angle(angle.to_string()));
        }
        let on_fine = numbers(fine);
        let mut seen = std::collections::BTreeSet::new();
        if let Some(&twice) = on_fine.iter().find(|beam| !seen.insert(**beam)) {
            return Err(RingError::Twice(fine.angle_deg(twice).to_string()));
        }
        let is_held = on_fine.iter().zip(numbers(self)).all(|(fine_number, own)| {
            (fine.angle_deg(*fine_number) - self.angle_deg(own)).abs() < 0.5 * fine.step_deg()
        });
        Ok(if is_held && self.set(&numbers(self)).is_ok() { self } else { fine })
    }

    /// Number of angles.
    pub fn count(&self) -> u16 {
        self.count
    }

    /// Steps that beams are at least apart.
    pub fn gap(&self) -> u16 {
        self.gap
    }

    /// Degrees between neighbours.
    pub fn step_deg(&self) -> f64 {
        360.0 / f64::from(self.count)
    }

    /// Gantry angle, degrees in [0, 360).
    pub fn angle_deg(&self, beam: u16) -> f64 {
        f64::from(beam) * self.step_deg()
    }

    /// Number of the angle nearest to `angle_deg`, which may lie any number of turns away.
    pub fn nearest(&self, angle_deg: f64) -> u16 {
        let steps = (angle_deg.rem_euclid(360.0) / self.step_deg()).round() as u32;
        (steps % u32::from(self.count)) as u16
    }

    /// Steps between two beams the shorter way round.
    pub fn steps_between(&self, a: u16, b: u16) -> u16 {
        let there = a.abs_diff(b) % self.count;
        there.min(self.count - there)
    }

    /// Whether `beam` is far enough from each of `others`.
    pub fn fits(&self, beam: u16, others: &[u16]) -> bool {
        others.iter().all(|other| self.steps_between(beam, *other) >= self.gap)
    }

    /// Beams that may be added to `others`, rising.
    pub fn legal(&self, others: &[u16]) -> Vec<u16> {
        (0..self.count).filter(|beam| self.fits(*beam, others)).collect()
    }

    /// The set of these beams, in any order.
    pub fn set(&self, beams: &[u16]) -> Result<BeamSet, RingError> {
        let mut sorted = beams.to_vec();
        sorted.sort_unstable();
        if let Some(&beam) = sorted.iter().find(|beam| **beam >= self.count) {
            return Err(RingError::Place { beam, count: self.count });
        }
        let next = |i: usize| sorted[(i + 1) % sorted.len()];
        let near = |&i: &usize| sorted.len() > 1 && self.steps_between(sorted[i], next(i)) < self.gap;
        if let Some(i) = (0..sorted.len()).find(near) {
            return Err(RingError::Near { a: sorted[i], b: next(i), count: self.count, gap: self.gap });
        }
        Ok(BeamSet(sorted))
    }

    /// Whether sets of `beams` exist.
    pub fn check_room(&self, beams: usize) -> Result<(), RingError> {
        match beams {
            0 => Err(RingError::NoBeam),
            1 => Ok(()),
            _ if beams * usize::from(self.gap) <= usize::from(self.count) => Ok(()),
            _ => Err(RingError::Crowded { beams, gap: self.gap, count: self.count }),
        }
    }

    /// How many sets of `beams` there are: `n / (n - k (g - 1)) C(n - k (g - 1), k)`; `None` beyond `u128`.
    pub fn sets(&self, beams: u16) -> Option<u128> {
        let (n, k, g) = (u128::from(self.count), u128::from(beams), u128::from(self.gap));
        match k {
            0 => Some(1),
            1 => Some(n),
            _ if k * g > n => Some(0),
            _ => {
                let free = n - k * (g - 1);
                binomial(free, k)?.checked_mul(n).map(|product| product / free)
            }
        }
    }
}

impl BeamSet {
    /// The beams, rising.
    pub fn beams(&self) -> &[u16] {
        &self.0
    }
}

fn binomial(n: u128, k: u128) -> Option<u128> {
    (1..=k.min(n - k)).try_fold(1_u128, |c, i| Some(c.checked_mul(n + 1 - i)? / i))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::Value;

    fn cases(prefix: &str) -> Vec<Value> {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../tests/vectors/g_angles.json");
        let vectors: Value = serde_json::from_slice(&std::fs::read(file).unwrap()).unwrap();
        let mut cases = vectors["cases"].as_array().unwrap().clone();
        cases.retain(|case| case["id"].as_str().unwrap().starts_with(prefix));
        assert!(!cases.is_empty());
        cases
    }

    const FOUR_DEGREES: Ring = Ring { count: 90, gap: 5 };

    #[test]
    fn distances_are_those_of_the_vectors() {
        let one_degree = Ring::new(360, 1).unwrap();
        for case in cases("dist") {
            let [a, b] = ["a", "b"].map(|k| case["in"][k].as_u64().unwrap() as u16);
            assert_eq!(u64::from(one_degree.steps_between(a, b)), case["out"]["distance"].as_u64().unwrap());
        }
    }

    #[test]
    fn any_angles_have_a_ring_and_those_of_the_usual_ring_keep_it() {
        let usual = Ring::new(90, 5).unwrap();
        assert_eq!(usual.for_angles(&[0.0, 40.0, -80.0, 720.0 + 120.0]), Ok(usual));
        for angles in [&[0.0, 90.0, 180.0, 270.0][..], &[-40.5, 13.37], &[0.0, 4.0], &[359.999, 180.0]] {
            let ring = usual.for_angles(angles).unwrap();
            for angle in angles {
                let off = (ring.angle_deg(ring.nearest(*angle)) - angle.rem_euclid(360.0)).abs();
                assert!(off.min(360.0 - off) <= 0.005 + 1e-9, "{angle}");
            }
        }
        let warning = |angles: &[f64]| usual.for_angles(angles).unwrap_err().to_string();
        assert!(warning(&[40.0, 400.0]).contains("40 degrees"));
        assert!(warning(&[f64::NAN]).contains("NaN"));
        assert!(usual.for_angles(&(0..360).map(f64::from).collect::<Vec<_>>()).is_ok());
    }

    #[test]
    fn angles_wrap_as_in_the_vectors() {
        for case in cases("wrap") {
            let beam = FOUR_DEGREES.nearest(case["in"]["raw"].as_f64().unwrap());
            assert_eq!(u64::from(beam), case["out"]["grid_index"].as_u64().unwrap());
            assert_eq!(FOUR_DEGREES.angle_deg(beam), case["out"]["wrapped"].as_f64().unwrap());
        }
    }

    #[test]
    fn legal_replacements_are_those_of_the_vectors() {
        for case in cases("mask") {
            let angles = case["in"]["beams"].as_array().unwrap().iter().map(|a| a.as_f64().unwrap());
            let mut others: Vec<u16> = angles.map(|a| FOUR_DEGREES.nearest(a)).collect();
            others.remove(case["in"]["replace_index"].as_u64().unwrap() as usize);
            let expected = case["out"]["legal_grid_indices"].as_array().unwrap();
            let expected: Vec<u16> = expected.iter().map(|i| i.as_u64().unwrap() as u16).collect();
            // The beam that stands there counts as legal.
            let legal = FOUR_DEGREES.legal(&others);
            assert_eq!(legal, expected, "{}", case["id"]);
        }
    }

    #[test]
    fn counts_of_sets_are_those_of_the_vectors() {
        for case in cases("count") {
            assert_eq!(FOUR_DEGREES.sets(5), case["out"]["sets"].as_u64().map(u128::from));
            assert_eq!(
                Ring::new(90, 1).unwrap().sets(5),
                case["out"]["unconstrained"].as_u64().map(u128::from)
            );
        }
    }

    #[test]
    fn counts_of_sets_are_those_of_counting() {
        for (count, gap) in [(7, 1), (9, 2), (11, 3), (12, 4)] {
            let ring = Ring::new(count, gap).unwrap();
            for k in 0..=5 {
                let all = (0_u32..1 << count).filter(|bits| bits.count_ones() == u32::from(k));
                let beams = |bits: u32| (0..count).filter(|b| bits >> b & 1 == 1).collect::<Vec<_>>();
                let counted = all.filter(|bits| ring.set(&beams(*bits)).is_ok()).count();
                assert_eq!(ring.sets(k), Some(counted as u128), "{k} of {count} with {gap}");
            }
        }
    }

    #[test]
    fn sets_that_break_the_rule_are_refused() {
        assert_eq!(FOUR_DEGREES.set(&[20, 0]).unwrap().beams(), [0, 20]);
        assert!(matches!(FOUR_DEGREES.set(&[0, 88]), Err(RingError::Near { a: 0, b: 88, .. })));
        assert!(matches!(FOUR_DEGREES.set(&[3, 3]), Err(RingError::Near { .. })));
        assert!(matches!(FOUR_DEGREES.set(&[90]), Err(RingError::Place { beam: 90, count: 90 })));
        assert!(FOUR_DEGREES.check_room(18).is_ok() && FOUR_DEGREES.check_room(19).is_err());
        assert_eq!(FOUR_DEGREES.check_room(0), Err(RingError::NoBeam));
    }
}
