//! By which method the dose of a plan is computed: what is fast enough for a search is not right in lung and behind air.

use std::fmt;
use std::str::FromStr;

use super::setup::PlanSetup;
use crate::beams::{Evaluated, RingDoses};
use crate::dose::{BeamAngles, DoseError, EngineName, LowDensity, UnknownEngine};

/// Share of the bixels of a plan that cross lung or air from which on a plan is made by superposition.
pub const LEAST_SHARE_CROSSING: f64 = 0.05;

/// A rule for the method by which dose is computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PlanEngine {
    /// Beams are searched by pencil beams. The fluence of the beams that were found is solved by superposition, and so are all
    /// figures, where these beams cross lung or air, on heads and necks, and for machines whose pencil kernels are of another
    /// beam.
    #[default]
    Auto,
    /// Pencil beams for all of it.
    Pencil,
    /// Superposition for all of it, the search included.
    Superposition,
}

impl PlanEngine {
    /// All rules.
    pub const ALL: [Self; 3] = [Self::Auto, Self::Pencil, Self::Superposition];

    /// The name as it is written.
    pub fn word(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Pencil => EngineName::Pencil.word(),
            Self::Superposition => EngineName::Superposition.word(),
        }
    }

    /// What the rule does, for people.
    pub fn about(self) -> &'static str {
        match self {
            Self::Auto => {
                "search by pencil beams; fluence and dose by superposition where the beams that were found cross lung or air, \
                 on heads and necks, and for machines that were fitted to measured doses"
            }
            Self::Pencil => EngineName::Pencil.about(),
            Self::Superposition => {
                "superposition of point kernels, for the search, too: a search takes minutes to hours"
            }
        }
    }

    /// The method of the search.
    pub fn of_search(self) -> EngineName {
        match self {
            Self::Auto | Self::Pencil => EngineName::Pencil,
            Self::Superposition => EngineName::Superposition,
        }
    }
}

impl fmt::Display for PlanEngine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}

impl FromStr for PlanEngine {
    type Err = UnknownEngine;

    fn from_str(text: &str) -> Result<Self, UnknownEngine> {
        let is_named = |name: &Self| name.word() == text;
        Self::ALL.into_iter().find(is_named).ok_or_else(|| UnknownEngine(text.to_owned()))
    }
}

impl PlanSetup {
    /// The method by which dose is computed.
    pub fn engine_name(&self) -> EngineName {
        self.engine().params().engine
    }

    /// The method by which a plan of these beams is to be made: that of the search, or superposition by
    /// [`PlanEngine::Auto`] where the machine has kernels.
    ///
    /// # Errors
    /// An angle out of range.
    pub fn engine_of_plan(&self, beams: &[u16]) -> Result<EngineName, DoseError> {
        self.engine_of_angles(&self.directions.all(beams))
    }

    /// The same for a plan of beams of these angles.
    ///
    /// # Errors
    /// An angle out of range.
    pub fn engine_of_angles(&self, angles: &[BeamAngles]) -> Result<EngineName, DoseError> {
        let has_kernels = self.spec.machine.file().superposition.is_some();
        if self.spec.engine != PlanEngine::Auto || !has_kernels {
            return Ok(self.engine_name());
        }
        let needs_superposition = self.spec.machine.pencil_caution().is_some()
            || self.case.is_head_or_neck()
            || self.low_density_at(angles)?.share() >= LEAST_SHARE_CROSSING;
        Ok(if needs_superposition { EngineName::Superposition } else { EngineName::Pencil })
    }

    /// What a person should know of the method by which the dose of a plan is computed whose bixels cross this lung and air.
    pub fn caution(&self, low_density: &LowDensity) -> Option<String> {
        if self.engine_name() != EngineName::Pencil {
            return None;
        }
        let both: Vec<String> =
            self.spec.machine.pencil_caution().into_iter().chain(low_density.caution()).collect();
        (!both.is_empty()).then(|| both.join(". "))
    }

    /// Lung and air on the rays of all bixels of these beams.
    ///
    /// # Errors
    /// An angle out of range.
    pub fn low_density_of(&self, beams: &[u16]) -> Result<LowDensity, DoseError> {
        self.low_density_at(&self.directions.all(beams))
    }

    /// The same of beams of these angles.
    ///
    /// # Errors
    /// An angle out of range.
    pub fn low_density_at(&self, beams: &[BeamAngles]) -> Result<LowDensity, DoseError> {
        let mut sum = LowDensity::default();
        for angles in beams {
            let bixels_mm = self.engine().bixels_mm(*angles)?;
            sum = sum.and(self.engine().low_density(*angles, &bixels_mm)?);
        }
        Ok(sum)
    }

    /// Lung and air on the rays of the bixels of a plan that have weight.
    ///
    /// # Errors
    /// An angle out of range.
    pub fn low_density(&self, plan: &Evaluated, doses: &RingDoses) -> Result<LowDensity, DoseError> {
        let mut sum = LowDensity::default();
        for beam in plan.beams.beams() {
            let weights = plan.weights_of(*beam).unwrap_or_default();
            let lit = doses.bixels_mm(*beam).iter().zip(weights).filter(|(_, weight)| **weight > 0.0);
            let lit: Vec<[f64; 2]> = lit.map(|(bixel, _)| *bixel).collect();
            sum = sum.and(self.engine().low_density(self.directions.angles(*beam), &lit)?);
        }
        Ok(sum)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rules_are_written_and_read_by_the_same_names() {
        for rule in PlanEngine::ALL {
            assert_eq!(rule.word().parse(), Ok(rule));
        }
        assert_eq!("cones".parse::<PlanEngine>(), Err(UnknownEngine("cones".to_owned())));
        let of_search = PlanEngine::ALL.map(PlanEngine::of_search);
        assert_eq!(of_search, [EngineName::Pencil, EngineName::Pencil, EngineName::Superposition]);
    }
}
