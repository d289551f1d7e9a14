//! Dose above a bound near the skin: an [`Overdose`] of a part of the structure.

use super::*;
use crate::fluence::text::Length;

/// The text form.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spec {
    dose: Dose,
    depth: Length,
    weight: f64,
}

pub(super) const EXAMPLES: &[&str] = &[r#"{"entry": {"dose": "50 %", "depth": "10 mm", "weight": 50}}"#];

impl super::Spec for Spec {
    fn doses(&self) -> Vec<Dose> {
        vec![self.dose]
    }

    fn resolve(&self, gray: &dyn Fn(Dose) -> f64) -> Objective {
        Overdose { dose: gray(self.dose), weight: self.weight }.into()
    }

    fn part(&self) -> StructurePart {
        StructurePart::Skin(self.depth.0)
    }
}
