//! Mean dose above a bound.

use super::*;

/// The text form.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spec {
    dose: Dose,
    weight: f64,
}

/// `weight max(0, mean - dose)^2`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MeanDose {
    /// Gray.
    #[serde(rename = "dose_gy")]
    pub dose: f64,
    /// Weight.
    pub weight: f64,
}

pub(super) const EXAMPLES: &[&str] = &[r#"{"mean_dose": {"dose": "30 %", "weight": 2}}"#];

impl super::Spec for Spec {
    fn doses(&self) -> Vec<Dose> {
        vec![self.dose]
    }

    fn resolve(&self, gray: &dyn Fn(Dose) -> f64) -> Objective {
        MeanDose { dose: gray(self.dose), weight: self.weight }.into()
    }
}

impl Shape for MeanDose {
    fn check(&self) -> Result<(), BadNumber> {
        BadNumber::unless_dose(self.dose)
    }

    fn cost(&self, at: &Doses<'_>) -> f64 {
        let off = (at.mean() - self.dose).max(0.0);
        self.weight * off * off
    }

    fn add(&self, region: Region<'_>, parts: &mut Parts<'_>) {
        parts.add_mean(region, Side::Over, self.dose, self.weight);
    }

    fn aim(&self) -> Aim {
        Aim::Mean(Bound::AtMost, self.dose)
    }

    fn tolerated_gy(&self) -> Option<f64> {
        Some(self.dose)
    }

    fn measure(&self, dvh: &Dvh) -> Option<Measured> {
        Some(Measured::gray("mean".to_owned(), dvh.mean(), Bound::AtMost, self.dose))
    }
}
