//! The stretch at a pressure: on the branch that a shell at rest is on, or an error (SCIENCE A7).
//!
//! The rigs and the controllers do not use this module yet: the reference vectors and its own tests do.

use super::Shell;
use super::pressure::{GREATEST_STRETCH, LEAST_STRETCH, LimitPoint};
use crate::root;

/// Why there is no stretch at a pressure.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum InverseError {
    /// More than the shell can hold: it would swell without bound or jump to another branch.
    #[error(
        "{pressure} Pa is beyond the limit pressure of {limit} Pa at an inner stretch of {inner_stretch}; \
         stay below it, or state the amount of air instead"
    )]
    BeyondLimit {
        /// The pressure asked for, Pa.
        pressure: f64,
        /// The limit, Pa.
        limit: f64,
        /// Where the limit is.
        inner_stretch: f64,
    },
    /// A pressure outside the pressures of the allowed stretches, or a number that is not finite.
    #[error(
        "{pressure} Pa is not between {least} and {greatest} Pa, the pressures at stretches of 0.001 and 60"
    )]
    OutOfRange {
        /// The pressure asked for, Pa.
        pressure: f64,
        /// Pressure at the least stretch, Pa.
        least: f64,
        /// Pressure at the greatest stretch, Pa.
        greatest: f64,
    },
}

impl Shell {
    /// Inner stretch at a pressure (Pa), on the branch that contains the stretch 1: where loading from rest leads.
    ///
    /// # Errors
    /// [`InverseError::BeyondLimit`] above the first limit pressure, never a root of another branch;
    /// [`InverseError::OutOfRange`] for pressures that no stretch from 0.001 to 60 has.
    pub fn inner_stretch_at(&self, pressure: f64) -> Result<f64, InverseError> {
        let limit = self.limit_points().first().copied();
        let end = limit.map_or(GREATEST_STRETCH, |l| l.inner_stretch);
        if let Some(LimitPoint { inner_stretch, pressure: limit }) = limit
            && pressure > limit
        {
            return Err(InverseError::BeyondLimit { pressure, limit, inner_stretch });
        }
        let (least, greatest) = (self.pressure(LEAST_STRETCH), self.pressure(end));
        if !(least..=greatest).contains(&pressure) {
            return Err(InverseError::OutOfRange { pressure, least, greatest });
        }
        Ok(self.branch_root(pressure, LEAST_STRETCH, end, 1.0))
    }

    /// All inner stretches from 0.001 to 60 at which the shell has this pressure (Pa), in rising order: up to three.
    pub fn inner_stretches_at(&self, pressure: f64) -> Vec<f64> {
        let mut ends = vec![LEAST_STRETCH];
        ends.extend(self.limit_points().iter().map(|l| l.inner_stretch));
        ends.push(GREATEST_STRETCH);
        let mut found = Vec::new();
        for pair in ends.windows(2) {
            let &[low, high] = pair else { continue };
            let (at_low, at_high) = (self.pressure(low) - pressure, self.pressure(high) - pressure);
            if at_low <= 0.0 && at_high >= 0.0 {
                found.push(self.branch_root(pressure, low, high, low.max(1.0)));
            } else if at_low >= 0.0 && at_high <= 0.0 {
                found.push(root::bisect(|l| self.pressure(l) - pressure, low, high));
            }
        }
        found
    }

    fn branch_root(&self, pressure: f64, low: f64, high: f64, start: f64) -> f64 {
        let excess = |l: f64| {
            let (value, slope) = self.pressure_with_slope(l);
            (value - pressure, slope)
        };
        root::newton(excess, low, high, start)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_stretch_of_a_pressure_has_that_pressure(stretch in 0.3..6.0f64) {
            let shell = Shell::rig();
            let found = shell.inner_stretch_at(shell.pressure(stretch)).unwrap();
            prop_assert!((found - stretch).abs() < 1e-9, "{found} {stretch}");
        }

        #[test]
        fn no_pressure_beyond_the_limit_has_a_stretch(over in 1.0001..5.0f64, share in 0.0..0.2f64) {
            let shell = Shell::new(4e4, 4e4 * share, 0.05, 0.055).unwrap();
            let limit = shell.limit_points()[0];
            let below = shell.inner_stretch_at(limit.pressure * 0.999).unwrap();
            prop_assert!(below < limit.inner_stretch);
            let error = shell.inner_stretch_at(limit.pressure * over).unwrap_err();
            let beyond = matches!(error, InverseError::BeyondLimit { .. });
            prop_assert!(beyond, "{error}");
        }
    }

    #[test]
    fn pressures_that_are_no_numbers_are_refused() {
        for bad in [f64::NAN, f64::NEG_INFINITY, f64::INFINITY] {
            let error = Shell::rig().inner_stretch_at(bad).unwrap_err();
            assert!(matches!(error, InverseError::OutOfRange { .. }), "{error}");
        }
    }
}
