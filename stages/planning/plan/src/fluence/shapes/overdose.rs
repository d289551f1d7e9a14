//! Dose above a bound, voxel by voxel.

use super::*;

/// The text form.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spec {
    dose: Dose,
    weight: f64,
}

/// `weight / v sum max(0, d - dose)^2`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Overdose {
    /// Gray.
    #[serde(rename = "dose_gy")]
    pub dose: f64,
    /// Weight.
    pub weight: f64,
}

pub(super) const EXAMPLES: &[&str] = &[r#"{"overdose": {"dose": "50 %", "weight": 20}}"#];


impl super::Spec for Spec {
    fn doses(&self) -> Vec<Dose> {
        vec![self.dose]
    }

    fn resolve(&self, gray: &dyn Fn(Dose) -> f64) -> Objective {
        Overdose { dose: gray(self.dose), weight: self.weight }.into()
    }
}

impl Shape for Overdose {
    fn check(&self) -> Result<(), BadNumber> {
        BadNumber::unless_dose(self.dose)
    }

    fn cost(&self, at: &Doses<'_>) -> f64 {
        self.weight / at.whole() * at.squares(|d| (d - self.dose).max(0.0))
    }

    fn add(&self, region: Region<'_>, parts: &mut Parts<'_>) {
        parts.add_each(region, Side::Over, self.dose, self.weight);
    }

    fn aim(&self) -> Aim {
        Aim::Dose(Bound::AtMost, self.dose)
    }

    fn tolerated_gy(&self) -> Option<f64> {
        Some(self.dose)
    }

    fn measure(&self, _: &Dvh) -> Option<Measured> {
        None
    }
}
