//! A volume that may get more than a dose, given by both numbers.

use super::*;
use crate::fluence::dvh;
use crate::fluence::text::Volume;

/// The text form.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spec {
    dose: Dose,
    volume: Volume,
    weight: f64,
}

/// At most `volume` (a fraction) gets more than `dose`. With `d_v` the dose that `volume` gets now, voxels between
/// `dose` and `d_v` cost `weight / v (d - dose)^2`; the hottest `volume` is free. Not convex.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DvhAtMost {
    /// Gray.
    #[serde(rename = "dose_gy")]
    pub dose: f64,
    /// Fraction of the structure.
    pub volume: f64,
    /// Weight.
    pub weight: f64,
}

pub(super) const EXAMPLES: &[&str] =
    &[r#"{"dvh_at_most": {"dose": "60 %", "volume": "30 %", "weight": 10}}"#];

impl super::Spec for Spec {
    fn doses(&self) -> Vec<Dose> {
        vec![self.dose]
    }

    fn resolve(&self, gray: &dyn Fn(Dose) -> f64) -> Objective {
        DvhAtMost { dose: gray(self.dose), volume: self.volume.part(), weight: self.weight }.into()
    }
}

impl Shape for DvhAtMost {
    fn check(&self) -> Result<(), BadNumber> {
        BadNumber::unless_dose(self.dose)?;
        BadNumber::unless_volume(self.volume)
    }

    fn cost(&self, at: &Doses<'_>) -> f64 {
        let whole = at.whole();
        dvh::cost(at.points, Side::Over, self.volume * whole, self.dose, self.weight / whole)
    }

    fn add(&self, region: Region<'_>, parts: &mut Parts<'_>) {
        parts.add_dvh(region, Side::Over, self.dose, self.volume, self.weight);
    }

    fn aim(&self) -> Aim {
        Aim::Volume { bound: Bound::AtMost, dose: self.dose, volume: self.volume }
    }

    fn tolerated_gy(&self) -> Option<f64> {
        Some(self.dose)
    }

    fn measure(&self, dvh: &Dvh) -> Option<Measured> {
        let found = dvh.volume_at(self.dose);
        Some(Measured::fraction(format!("V{}Gy", short(self.dose)), found, Bound::AtMost, self.volume))
    }
}
