//! A DVH point as it is written in protocols: `D95% >= 50 Gy`, `V20Gy <= 30 %`.

use super::*;
use crate::fluence::dvh;
use crate::fluence::text::{DvhText, Reading};

/// The text form.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spec {
    limit: DvhText,
    weight: f64,
}

/// A point of the histogram that is to lie on one side of a limit. Its cost is the usual convex surrogate (Wu and Mohan,
/// Med. Phys. 27 (2000) 701): `weight / v (d - dose)^2` of the voxels between `dose` and the dose that `volume` gets now;
/// the rest is free. The voxels are chosen anew after each solve of the fluence, until they stay. Not convex.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DvhPoint {
    /// Which of the two numbers is measured at the other.
    pub reading: Reading,
    /// At most: no more than `volume` gets more than `dose`. At least: no less than `volume` gets `dose`.
    pub bound: Bound,
    /// Gray.
    #[serde(rename = "dose_gy")]
    pub dose: f64,
    /// Fraction of the structure.
    pub volume: f64,
    /// Weight.
    pub weight: f64,
}

pub(super) const EXAMPLES: &[&str] = &[
    r#"{"dvh_point": {"limit": "D95% >= 50 Gy", "weight": 100}}"#,
    r#"{"dvh_point": {"limit": "D5% <= 40 %", "weight": 100}}"#,
    r#"{"dvh_point": {"limit": "V20Gy <= 30 %", "weight": 10}}"#,
    r#"{"dvh_point": {"limit": "V95% >= 98 %", "weight": 10}}"#,
];

impl super::Spec for Spec {
    fn doses(&self) -> Vec<Dose> {
        vec![self.limit.dose]
    }

    fn resolve(&self, gray: &dyn Fn(Dose) -> f64) -> Objective {
        let DvhText { reading, bound, dose, volume } = self.limit;
        DvhPoint { reading, bound, dose: gray(dose), volume: volume.part(), weight: self.weight }.into()
    }
}

impl DvhPoint {
    fn side(&self) -> Side {
        match self.bound {
            Bound::AtMost => Side::Over,
            Bound::AtLeast => Side::Under,
        }
    }
}

impl Shape for DvhPoint {
    fn check(&self) -> Result<(), BadNumber> {
        BadNumber::unless_dose(self.dose)?;
        BadNumber::unless_volume(self.volume)
    }

    fn cost(&self, at: &Doses<'_>) -> f64 {
        let whole = at.whole();
        dvh::cost(at.points, self.side(), self.volume * whole, self.dose, self.weight / whole)
    }

    fn add(&self, region: Region<'_>, parts: &mut Parts<'_>) {
        parts.add_dvh(region, self.side(), self.dose, self.volume, self.weight);
    }

    fn aim(&self) -> Aim {
        Aim::Volume { bound: self.bound, dose: self.dose, volume: self.volume }
    }

    fn tolerated_gy(&self) -> Option<f64> {
        (self.bound == Bound::AtMost).then_some(self.dose)
    }

    fn measure(&self, dvh: &Dvh) -> Option<Measured> {
        Some(match self.reading {
            Reading::DoseAtVolume => {
                let percent = 100.0 * self.volume;
                let name = format!("D{}%", short(percent));
                Measured::gray(name, dvh.dose_at(percent), self.bound, self.dose)
            }
            Reading::VolumeAtDose => {
                let name = format!("V{}Gy", short(self.dose));
                Measured::fraction(name, dvh.volume_at(self.dose), self.bound, self.volume)
            }
        })
    }
}
