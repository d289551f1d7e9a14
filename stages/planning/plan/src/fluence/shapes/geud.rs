//! Generalised equivalent uniform dose above or below a bound.

use super::*;
use crate::fluence::region::{PowerMean, RegionTerm};
use crate::fluence::text::DoseBound;

/// The text form.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spec {
    a: f64,
    limit: DoseBound,
    weight: f64,
}

/// `weight max(0, +-(gEUD - dose))^2` with `gEUD = (1/v sum d^a)^(1/a)` (Niemierko, Med. Phys. 26 (1999) 1100; as an
/// objective: Wu, Mohan, Niemierko and Schmidt-Ullrich, Int. J. Radiat. Oncol. Biol. Phys. 52 (2002) 224).
///
/// Convex in its allowed ranges: for `a >= 1` gEUD is convex and may be bounded above, for `a <= 1` it is concave on doses
/// that are not negative and may be bounded below. A bound below counts every dose as 1 % of the bound more, and takes that
/// off again, so that a voxel without dose has a slope.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Geud {
    /// Exponent: large for organs that fail with their hottest part, 1 for the mean, negative for targets.
    pub a: f64,
    /// At most, or at least.
    pub bound: Bound,
    /// Gray.
    #[serde(rename = "dose_gy")]
    pub dose: f64,
    /// Weight.
    pub weight: f64,
}

pub(super) const EXAMPLES: &[&str] = &[
    r#"{"geud": {"a": 8, "limit": "<= 30 %", "weight": 20}}"#,
    r#"{"geud": {"a": 1.5, "limit": "<= 20 Gy", "weight": 20}}"#,
    r#"{"geud": {"a": -10, "limit": ">= 100 %", "weight": 100}}"#,
];

impl super::Spec for Spec {
    fn doses(&self) -> Vec<Dose> {
        vec![self.limit.dose]
    }

    fn resolve(&self, gray: &dyn Fn(Dose) -> f64) -> Objective {
        let DoseBound { bound, dose } = self.limit;
        Geud { a: self.a, bound, dose: gray(dose), weight: self.weight }.into()
    }
}

/// Part of the bound that doses are raised by where it is a bound below.
const RAISE: f64 = 0.01;

impl Geud {
    fn term(&self, rows: Vec<(u32, f64)>) -> RegionTerm {
        let (side, raise) = match self.bound {
            Bound::AtMost => (Side::Over, 0.0),
            Bound::AtLeast => (Side::Under, RAISE * self.dose),
        };
        RegionTerm { rows, mean: PowerMean { a: self.a, raise }, side, goal: self.dose, weight: self.weight }
    }
}

impl Shape for Geud {
    fn check(&self) -> Result<(), BadNumber> {
        BadNumber::unless_dose(self.dose)?;
        let Self { a, .. } = *self;
        match self.bound {
            Bound::AtMost => BadNumber::unless(
                (1.0..=100.0).contains(&a),
                "the exponent a of a gEUD with an upper bound",
                a,
                "between 1 and 100, where the cost is convex",
            ),
            Bound::AtLeast => BadNumber::unless(
                (-100.0..=-0.1).contains(&a) || (0.1..=1.0).contains(&a),
                "the exponent a of a gEUD with a lower bound",
                a,
                "between -100 and -0.1 or between 0.1 and 1, where the cost is convex",
            ),
        }
    }

    fn cost(&self, at: &Doses<'_>) -> f64 {
        let whole = at.whole();
        let rows = (0..).zip(at.points).map(|(row, (_, volume))| (row, volume / whole)).collect();
        let doses: Vec<f64> = at.points.iter().map(|(d, _)| *d).collect();
        self.term(rows).cost(&doses)
    }

    fn add(&self, region: Region<'_>, parts: &mut Parts<'_>) {
        parts.regions.push(self.term(region.shares()));
    }

    fn aim(&self) -> Aim {
        Aim::Geud { a: self.a, bound: self.bound, dose: self.dose }
    }

    fn tolerated_gy(&self) -> Option<f64> {
        (self.bound == Bound::AtMost).then_some(self.dose)
    }

    fn measure(&self, dvh: &Dvh) -> Option<Measured> {
        Some(Measured::gray(format!("gEUD({})", self.a), dvh.geud(self.a), self.bound, self.dose))
    }
}
