//! The stretch that an amount of air gives: what a valve moves is air, not pressure (SCIENCE A7).
//!
//! `(P_atm + P(lambda_i)) V(lambda_i) = m R_s T`: its left side grows with the stretch, so there is one root, and it
//! stays stable beyond the pressure's maximum.

use super::Shell;
use super::pressure::{GREATEST_STRETCH, LEAST_STRETCH};
use crate::root;

/// The gas in the bladders and around them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Air {
    /// Specific gas constant, J/(kg K).
    pub gas_constant: f64,
    /// Ratio of the heat capacities.
    pub gamma: f64,
    /// Temperature, K: walls and room hold it (SCIENCE C3).
    pub temperature: f64,
    /// Absolute pressure of the room, Pa.
    pub atmosphere: f64,
}

impl Air {
    /// Air of 295 K at sea level.
    pub const ROOM: Self =
        Self { gas_constant: 287.05, gamma: 1.4, temperature: 295.0, atmosphere: 101_325.0 };

    /// Pressure times volume of a mass of this gas, `R_s T`, J/kg.
    pub fn specific_energy(&self) -> f64 {
        self.gas_constant * self.temperature
    }

    /// Mass of this gas in a volume (m^3) at a gauge pressure (Pa), kg.
    pub fn mass(&self, gauge: f64, volume: f64) -> f64 {
        (self.atmosphere + gauge) * volume / self.specific_energy()
    }
}

/// Why an amount of air gives no stretch.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum AirError {
    /// No air, less than none, or no number.
    #[error("{mass} kg is not an amount of air; give a finite amount above 0")]
    Mass {
        /// The mass given, kg.
        mass: f64,
    },
    /// More or less air than a shell holds at the allowed stretches.
    #[error(
        "{mass} kg of air is not between {least} and {greatest} kg, what the shell holds at stretches of {LEAST_STRETCH} and {GREATEST_STRETCH}"
    )]
    OutOfRange {
        /// The mass given, kg.
        mass: f64,
        /// Mass at the least stretch, kg.
        least: f64,
        /// Mass at the greatest stretch, kg.
        greatest: f64,
    },
}

impl Shell {
    /// Inner stretch of a free shell with `mass` kg of air in it.
    ///
    /// # Errors
    /// [`AirError`] for a mass that is no amount, or that takes the shell beyond the stretches 0.001 to 60.
    pub fn inner_stretch_with(&self, mass: f64, air: &Air) -> Result<f64, AirError> {
        if !(mass.is_finite() && mass > 0.0) {
            return Err(AirError::Mass { mass });
        }
        let held = |stretch| air.mass(self.pressure(stretch), self.cavity_volume(stretch));
        let (least, greatest) = (held(LEAST_STRETCH).max(0.0), held(GREATEST_STRETCH));
        if !(least..=greatest).contains(&mass) {
            return Err(AirError::OutOfRange { mass, least, greatest });
        }
        // Over the volume at rest, so that the numbers are pressures.
        let target = mass * air.specific_energy() / self.cavity_volume(1.0);
        let excess = |l: f64| {
            let (pressure, slope) = self.pressure_with_slope(l);
            let (square, absolute) = (l * l, air.atmosphere + pressure);
            (absolute * square * l - target, slope * square * l + 3.0 * absolute * square)
        };
        Ok(root::newton(excess, LEAST_STRETCH, GREATEST_STRETCH, 1.1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_stretch_holds_the_air_that_was_put_in(
            stretch in 0.4..8.0f64,
            ratio in 1.005..1.5f64,
            share in 0.0..1.0f64,
        ) {
            let shell = Shell::new(4e4, 4e4 * share, 0.05, 0.05 * ratio).unwrap();
            let mass = Air::ROOM.mass(shell.pressure(stretch), shell.cavity_volume(stretch));
            prop_assume!(mass > 0.0);
            let found = shell.inner_stretch_with(mass, &Air::ROOM).unwrap();
            prop_assert!((found - stretch).abs() < 1e-10 * stretch, "{found} {stretch}");
        }

        #[test]
        fn any_number_is_a_stretch_or_refused(mass in prop_oneof![any::<f64>(), 0.0..1.0f64]) {
            if let Ok(stretch) = Shell::rig().inner_stretch_with(mass, &Air::ROOM) {
                prop_assert!((LEAST_STRETCH..=GREATEST_STRETCH).contains(&stretch), "{stretch}");
            }
        }
    }
}
