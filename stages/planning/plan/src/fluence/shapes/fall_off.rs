//! Dose above a bound that falls with the distance to the targets.

use super::*;
use crate::fluence::text::Length;

/// The text form.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spec {
    near: Dose,
    far: Dose,
    over: Length,
    weight: f64,
}

/// `weight / v sum max(0, d - goal(r))^2`, where `r` is a voxel's distance to the nearest target. The goal falls linearly
/// from `near` at the target to `far` at `over_mm` and stays there; `v` is the volume within `over_mm`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FallOff {
    /// Gray.
    #[serde(rename = "near_gy")]
    pub near: f64,
    /// Gray, not above `near`.
    #[serde(rename = "far_gy")]
    pub far: f64,
    /// Millimetres, above 0.
    pub over_mm: f64,
    /// Weight.
    pub weight: f64,
}

pub(super) const EXAMPLES: &[&str] =
    &[r#"{"fall_off": {"near": "100 %", "far": "60 %", "over": "13 mm", "weight": 150}}"#];

impl super::Spec for Spec {
    fn doses(&self) -> Vec<Dose> {
        vec![self.near, self.far]
    }

    fn resolve(&self, gray: &dyn Fn(Dose) -> f64) -> Objective {
        let (near, far) = (gray(self.near), gray(self.far));
        FallOff { near, far, over_mm: self.over.0, weight: self.weight }.into()
    }

    fn part(&self) -> StructurePart {
        StructurePart::OutsideTargets
    }
}

impl FallOff {
    fn goal(&self, to_target_mm: f64) -> f64 {
        self.near + (self.far - self.near) * (to_target_mm / self.over_mm).min(1.0)
    }
}

impl Shape for FallOff {
    fn check(&self) -> Result<(), BadNumber> {
        BadNumber::unless_dose(self.near)?;
        BadNumber::unless(
            (0.0..=self.near).contains(&self.far),
            "the dose at the end of a fall-off",
            self.far,
            "between 0 Gy and the dose at its beginning",
        )?;
        BadNumber::unless(
            self.over_mm.is_finite() && self.over_mm > 0.0,
            "the length of a fall-off",
            self.over_mm,
            "a finite number of millimetres above 0",
        )
    }

    fn cost(&self, at: &Doses<'_>) -> f64 {
        let (mut within, mut sum) = (0.0, 0.0);
        for ((d, volume), r) in at.points.iter().zip(at.to_target_mm) {
            let off =
                (d - self.near - (self.far - self.near) * (r / self.over_mm).min(1.0)).max(0.0);
            sum += volume * off * off;
            within += if *r <= self.over_mm { *volume } else { 0.0 };
        }
        self.weight * sum / if within > 0.0 { within } else { at.whole() }
    }

    fn add(&self, region: Region<'_>, parts: &mut Parts<'_>) {
        let with_distance = || region.both().zip(region.to_target_mm);
        let within: f64 =
            with_distance().filter(|(_, r)| **r <= self.over_mm).map(|((_, v), _)| v).sum();
        let unit = if within > 0.0 { within } else { region.whole() };
        parts.terms.extend(with_distance().map(|((row, v), r)| {
            let weight = self.weight * v / unit;
            Term { row, side: Side::Over, goal: self.goal(*r), weight }
        }));
    }

    fn aim(&self) -> Aim {
        Aim::FallOff { near: self.near, far: self.far, over_mm: self.over_mm }
    }

    fn tolerated_gy(&self) -> Option<f64> {
        None
    }

    fn measure(&self, _: &Dvh) -> Option<Measured> {
        None
    }

    fn needs_distances(&self) -> bool {
        true
    }
}
