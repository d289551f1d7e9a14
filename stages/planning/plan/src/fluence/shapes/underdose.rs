//! Dose below a bound, voxel by voxel.

use super::*;

/// The text form.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spec {
    dose: Dose,
    weight: f64,
}

/// `weight / v sum max(0, dose - d)^2`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Underdose {
    /// Gray.
    #[serde(rename = "dose_gy")]
    pub dose: f64,
    /// Weight.
    pub weight: f64,
}

pub(super) const EXAMPLES: &[&str] = &[r#"{"underdose": {"dose": "100 %", "weight": 1600}}"#];

impl super::Spec for Spec {
    fn doses(&self) -> Vec<Dose> {
        vec![self.dose]
    }

    fn resolve(&self, gray: &dyn Fn(Dose) -> f64) -> Objective {
        Underdose { dose: gray(self.dose), weight: self.weight }.into()
    }
}

impl Shape for Underdose {
    fn check(&self) -> Result<(), BadNumber> {
        BadNumber::unless_dose(self.dose)
    }

    fn cost(&self, at: &Doses<'_>) -> f64 {
        self.weight / at.whole() * at.squares(|d| (self.dose - d).max(0.0))
    }

    fn add(&self, region: Region<'_>, parts: &mut Parts<'_>) {
        parts.add_each(region, Side::Under, self.dose, self.weight);
    }

    fn aim(&self) -> Aim {
        Aim::Dose(Bound::AtLeast, self.dose)
    }

    fn tolerated_gy(&self) -> Option<f64> {
        None
    }

    fn measure(&self, _: &Dvh) -> Option<Measured> {
        None
    }
}
