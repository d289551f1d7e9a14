//! How much air an orifice lets through: the ideal orifice, choked where the air reaches the speed of sound (SCIENCE C3).

use core::f64::consts::PI;

use crate::shell::air::Air;

/// Above this ratio of the pressures the flow falls to zero in a straight line: its slope at 1 would be infinite.
const LINEAR_FROM: f64 = 0.999;

/// The law of an orifice for one gas: flow per area and upstream pressure by the ratio of the pressures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Orifice {
    /// `psi` where the flow is choked.
    choked: f64,
    /// Ratio of the pressures at or below which it is.
    critical: f64,
    /// `psi` at [`LINEAR_FROM`].
    last: f64,
    gamma: f64,
    /// `1 / sqrt(R_s T)`.
    slowness: f64,
}

impl Orifice {
    /// The law for a gas with `gamma` above 1.
    pub fn new(air: &Air) -> Self {
        let gamma = air.gamma;
        let base = 2.0 / (gamma + 1.0);
        let mut law = Self {
            choked: libm::sqrt(gamma) * libm::pow(base, 0.5 * (gamma + 1.0) / (gamma - 1.0)),
            critical: libm::pow(base, gamma / (gamma - 1.0)),
            last: 0.0,
            gamma,
            slowness: 1.0 / libm::sqrt(air.specific_energy()),
        };
        law.last = law.subsonic(LINEAR_FROM);
        law
    }

    fn subsonic(&self, ratio: f64) -> f64 {
        let gamma = self.gamma;
        let power = libm::pow(ratio, 2.0 / gamma) - libm::pow(ratio, (gamma + 1.0) / gamma);
        libm::sqrt(2.0 * gamma / (gamma - 1.0) * power)
    }

    /// Flow from `upstream` to `downstream` (absolute, Pa) through an effective area (m^2, the discharge coefficient
    /// in it), kg/s. It is negative where the pressure downstream is the higher one, and 0 where there is no gas.
    pub fn flow(&self, effective_area: f64, upstream: f64, downstream: f64) -> f64 {
        if downstream > upstream {
            return -self.flow(effective_area, downstream, upstream);
        }
        if upstream <= 0.0 {
            return 0.0;
        }
        let ratio = downstream.max(0.0) / upstream;
        let psi = if ratio <= self.critical {
            self.choked
        } else if ratio <= LINEAR_FROM {
            self.subsonic(ratio)
        } else {
            self.last * (1.0 - ratio) / (1.0 - LINEAR_FROM)
        };
        effective_area * upstream * self.slowness * psi
    }
}

/// The valves of a rig: an inlet from the supply and an outlet to the vacuum for each bladder, all alike.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Valves {
    /// Discharge coefficient of the orifice.
    pub discharge: f64,
    /// Diameter of the orifice, m.
    pub diameter: f64,
    /// Time constant with which an opening follows its duty, s.
    pub lag: f64,
    /// Absolute pressure before the inlets, Pa.
    pub supply: f64,
    /// Absolute pressure behind the outlets, Pa.
    pub exhaust: f64,
}

impl Valves {
    /// Orifices of 1 mm between a supply of 15 psi gauge and a vacuum of 12 psi below the room's pressure.
    /// Diameter, discharge coefficient and lag are assumptions of ours.
    pub fn rig() -> Self {
        const PSI: f64 = 6_894.757_293_168_361;
        let room = Air::ROOM.atmosphere;
        Self {
            discharge: 0.8,
            diameter: 1e-3,
            lag: 0.02,
            supply: room + 15.0 * PSI,
            exhaust: room - 12.0 * PSI,
        }
    }

    /// Effective area at an opening from 0 to 1, m^2.
    pub fn effective_area(&self, opening: f64) -> f64 {
        self.discharge * opening * 0.25 * PI * self.diameter * self.diameter
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn air_flows_down_the_pressure_and_the_more_the_larger_the_fall(
            upstream in 1e4..4e5f64,
            one in 0.0..1.2f64,
            other in 0.0..1.2f64,
        ) {
            let law = Orifice::new(&Air::ROOM);
            let flow = |ratio: f64| law.flow(1e-6, upstream, upstream * ratio);
            let (low, high) = (one.min(other), one.max(other));
            prop_assert!(flow(low) >= flow(high));
            prop_assert!((flow(one) >= 0.0) == (one <= 1.0));
        }

        #[test]
        fn the_flow_is_odd_in_the_pressures(upstream in 1e4..4e5f64, downstream in 1e4..4e5f64) {
            let law = Orifice::new(&Air::ROOM);
            prop_assert_eq!(law.flow(1e-6, upstream, downstream), -law.flow(1e-6, downstream, upstream));
        }
    }

    #[test]
    fn the_flow_has_no_jump_where_its_branches_meet() {
        let law = Orifice::new(&Air::ROOM);
        for ratio in [law.critical, LINEAR_FROM] {
            let (below, above) =
                (law.flow(1.0, 1e5, 1e5 * (ratio - 1e-9)), law.flow(1.0, 1e5, 1e5 * (ratio + 1e-9)));
            assert!((below - above).abs() < 1e-4 * law.flow(1.0, 1e5, 0.0), "{ratio}: {below} {above}");
        }
    }

    #[test]
    fn air_chokes_at_the_ratio_of_the_textbooks() {
        let law = Orifice::new(&Air::ROOM);
        assert!((law.critical - 0.52828).abs() < 1e-5 && (law.choked - 0.6847).abs() < 1e-4, "{law:?}");
    }
}
