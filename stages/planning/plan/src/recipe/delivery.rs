//! The check of a plan before it leaves: the same for every program that plans.

use std::num::NonZeroUsize;

use super::setup::PlanSetup;
use crate::check::{Bounds, Check, Checked, CheckedPlan, check};
use crate::dose::DoseError;
use crate::recompute::BeamFluence;

/// What of a plan is delivered.
#[derive(Clone, Copy, Debug)]
pub struct Delivery<'a> {
    /// The fluence as it was optimised.
    pub planned: &'a [BeamFluence],
    /// The fluence that is delivered: that of the segments where there are some.
    pub delivered: &'a [BeamFluence],
    /// Monitor units of a fraction, where the fluence is sequenced.
    pub monitor_units: Option<f64>,
    /// Displacement of the patient for which it was planned, mm.
    pub moved_mm: [f64; 3],
}

impl PlanSetup {
    /// Checks a plan for this set-up against the [`Bounds`] of plans.
    ///
    /// # Errors
    /// A dose cannot be computed.
    pub fn check(&self, delivery: &Delivery<'_>, threads: NonZeroUsize) -> Result<Checked, DoseError> {
        let Delivery { planned, delivered, monitor_units, moved_mm } = *delivery;
        let plan = CheckedPlan {
            case: &self.case,
            machine: &self.spec.machine,
            params: self.engine().params(),
            planned,
            delivered,
            monitor_units,
            moved_mm,
        };
        let bounds = Bounds::default();
        Ok(check(&Check::of(&plan, &bounds, threads)?, &bounds))
    }
}
