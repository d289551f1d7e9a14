//! Pressures of bladders, estimated from the duties that were sent, for rigs that do not measure them.
//!
//! Air flows through an inlet from the supply and through an outlet to the exhaust (the orifice law of SCIENCE C3; the
//! opening of a valve is its duty beyond the dead band, at once). The volume of a bladder is linear in the pressure, `V = V0 (1 + g / D)`,
//! so `(P_atm + g) V = m R_s T` is a quadratic in the gauge pressure `g`. With the defaults, incoming air raises the
//! pressure more than in the rig's bladders under a head. So the estimate errs upwards above the pressure at the start,
//! and downwards below it, where no limit is near. A bladder never counts as emptier than `V0` at the room's pressure.
//! The estimate knows nothing of leaks, loads and faults; a measured pressure replaces it.

use stillpoint_mechanics::plant::valve::{Orifice, Valves};
use stillpoint_mechanics::shell::air::Air;
use stillpoint_operator::Params;

/// Bladders that there is room for.
pub const BLADDERS: usize = 8;
/// The longest step of the integration, s.
const STEP: f64 = 0.01;
/// Longer pauses count as this many steps.
const STEPS: f64 = 200.0;

/// Pressures that are allowed, and what they are estimated from.
#[derive(Clone, Debug, Params)]
pub struct PressureParams {
    /// Largest pressure above that of the room. Inlets close on the way to the limit; a pressure above it is a fault.
    #[param(unit = "Pa", default = "40 kPa", above = "0 Pa", max = "200 kPa")]
    pub limit: f64,
    /// Distance below the limit from which an inlet opens less the nearer the estimate is to the limit.
    #[param(unit = "Pa", default = "4 kPa", above = "0 Pa", max = "100 kPa")]
    pub taper: f64,
    /// Pressure in the bladders at the start, above that of the room, one for all or one for each: rather too high than
    /// too low.
    #[param(unit = "Pa", default = "[15 kPa]", min = "0 Pa", max = "200 kPa")]
    pub start: Vec<f64>,
    /// Volume of a bladder at the room's pressure.
    #[param(unit = "m3", default = "0.52 l", above = "0 l", max = "20 l")]
    pub volume: f64,
    /// Pressure above that of the room at which a bladder has twice that volume.
    #[param(unit = "Pa", default = "50 kPa", above = "0 Pa", max = "10 MPa")]
    pub doubles_at: f64,
    /// Pressure of the supply above that of the room.
    #[param(unit = "Pa", default = "15 psi", min = "0 Pa", max = "10 bar")]
    pub supply: f64,
    /// Pressure of the vacuum below that of the room.
    #[param(unit = "Pa", default = "12 psi", min = "0 Pa", max = "1 bar")]
    pub vacuum: f64,
    /// Diameter of a valve's orifice.
    #[param(unit = "m", default = "1 mm", above = "0 mm", max = "20 mm")]
    pub orifice: f64,
    /// Discharge coefficient of the orifice.
    #[param(default = 0.8, above = 0, max = 1)]
    pub discharge: f64,
}

/// A bladder whose volume is linear in its pressure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compliance {
    /// Volume at the room's pressure, m3.
    pub volume: f64,
    /// Pressure above that of the room at which it has twice that volume, Pa.
    pub doubles_at: f64,
}

impl Compliance {
    /// Air in the bladder at a pressure above that of the room (Pa), kg.
    #[must_use]
    pub fn mass(&self, gauge: f64) -> f64 {
        Air::ROOM.mass(gauge, self.volume * (1.0 + gauge / self.doubles_at))
    }

    /// Pressure above that of the room with this much air (kg), Pa; 0 for less air than it holds at the room's pressure.
    #[must_use]
    pub fn gauge(&self, mass: f64) -> f64 {
        let air = Air::ROOM;
        // g^2 / D + (1 + P_atm / D) g - (m R_s T / V0 - P_atm) = 0
        let excess = mass * air.specific_energy() / self.volume - air.atmosphere;
        let half = 0.5 * (self.doubles_at + air.atmosphere);
        // The root without a difference of large numbers; the exact one for no excess is zero.
        let product = self.doubles_at * excess.max(0.0);
        product / (half + (half * half + product).sqrt())
    }
}

/// Estimates the pressure in each bladder. It does not allocate.
#[derive(Clone, Debug)]
pub struct PressureEstimator {
    law: Orifice,
    valves: Valves,
    bladder: Compliance,
    limit: f64,
    taper: f64,
    /// Air in each bladder, kg.
    mass: [f64; BLADDERS],
}

impl PressureEstimator {
    /// Bladders at their starting pressure.
    #[must_use]
    pub fn new(params: &PressureParams) -> Self {
        let air = Air::ROOM;
        let valves = Valves {
            discharge: params.discharge,
            diameter: params.orifice,
            lag: 0.0,
            supply: air.atmosphere + params.supply,
            exhaust: (air.atmosphere - params.vacuum).max(0.0),
        };
        let mut estimator = Self {
            law: Orifice::new(&air),
            valves,
            bladder: Compliance { volume: params.volume, doubles_at: params.doubles_at },
            limit: params.limit,
            taper: params.taper,
            mass: [0.0; BLADDERS],
        };
        let last = params.start.last().copied().unwrap_or_default();
        let starts = params.start.iter().copied().chain(std::iter::repeat(last));
        (0..BLADDERS).zip(starts).for_each(|(bladder, start)| estimator.correct(bladder, start));
        estimator
    }

    /// Replaces an estimate by a measured pressure, Pa above that of the room. A value that is not finite is not used.
    pub fn correct(&mut self, bladder: usize, gauge: f64) {
        if let Some(mass) = self.mass.get_mut(bladder)
            && gauge.is_finite()
        {
            *mass = self.bladder.mass(gauge.max(0.0));
        }
    }

    /// Lets `seconds` pass with the valves open so far: inlet and outlet of the first bladder, of the second, and so on.
    pub fn advance(&mut self, seconds: f64, openings: &[f64]) {
        self.pass(seconds, openings, self.valves.exhaust);
    }

    /// Lets `seconds` pass with the outlets of this many bladders open. A far end that vents by itself may vent into
    /// the room, which is slower than into a vacuum.
    pub fn vent(&mut self, seconds: f64, bladders: usize) {
        const OUTLETS: [f64; 2 * BLADDERS] = {
            let (mut open, mut outlet) = ([0.0; 2 * BLADDERS], 1);
            while outlet < open.len() {
                open[outlet] = 1.0;
                outlet += 2;
            }
            open
        };
        let exhaust = self.valves.exhaust.max(Air::ROOM.atmosphere);
        self.pass(seconds, OUTLETS.get(..2 * bladders).unwrap_or(&OUTLETS), exhaust);
    }

    fn pass(&mut self, seconds: f64, openings: &[f64], exhaust: f64) {
        if seconds.is_nan() || seconds <= 0.0 {
            return;
        }
        let steps = libm::ceil(seconds / STEP).clamp(1.0, STEPS);
        let dt = (seconds / steps).min(STEP);
        let least = self.bladder.mass(0.0);
        for _ in 0..steps as usize {
            for (bladder, pair) in openings.chunks_exact(2).take(BLADDERS).enumerate() {
                let inside = Air::ROOM.atmosphere + self.pressure(bladder);
                let area = |opening: f64| self.valves.effective_area(opening.clamp(0.0, 1.0));
                let flow_in = self.law.flow(area(pair[0]), self.valves.supply, inside);
                let flow_out = self.law.flow(area(pair[1]), inside, exhaust);
                self.mass[bladder] = (self.mass[bladder] + dt * (flow_in - flow_out)).max(least);
            }
        }
    }

    /// Pressure in a bladder above that of the room, Pa; 0 for a bladder that does not exist.
    #[must_use]
    pub fn pressure(&self, bladder: usize) -> f64 {
        self.mass.get(bladder).map_or(0.0, |mass| self.bladder.gauge(*mass))
    }

    /// How far the inlet of a bladder may be open: 1 well below the limit, 0 at it.
    #[must_use]
    pub fn ceiling(&self, bladder: usize) -> f64 {
        ((self.limit - self.pressure(bladder)) / self.taper).clamp(0.0, 1.0)
    }

    /// Whether a pressure is above the limit by more than rounding errors.
    #[must_use]
    pub fn is_exceeded(&self, bladders: usize) -> bool {
        (0..bladders).any(|bladder| self.pressure(bladder) > self.limit * (1.0 + 1e-6))
    }
}
