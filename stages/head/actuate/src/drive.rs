//! The last order to the valves and its effect: duties within bounds, and the estimated pressures.

use stillpoint_samples::ActuationReason as Reason;

use crate::message::{Order, Safe, VALVES};
use crate::pressure::{BLADDERS, PressureEstimator};
use crate::shaping::{Shaped, Shaper};

/// What is told of the valves that are driven.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Driven {
    /// How many: two for each bladder.
    pub valves: usize,
    /// What they do when orders stop.
    pub safe: Safe,
    /// Time for which an order is valid, ns.
    pub life: u64,
    /// How often orders are sent, ns.
    pub every: u64,
}

/// Shapes duties and estimates pressures, from order to order.
#[derive(Clone, Debug)]
pub struct Drive {
    driven: Driven,
    shaper: Shaper,
    pressure: PressureEstimator,
    /// When the last order was sent, ns, and which.
    last: Option<(u64, Order)>,
    /// Time since the order before, ns.
    gone: u64,
}

impl Drive {
    /// Valves without an order.
    #[must_use]
    pub fn new(driven: Driven, shaper: Shaper, pressure: PressureEstimator) -> Self {
        Self { driven, shaper, pressure, last: None, gone: driven.every }
    }

    /// Goes on to `now`, ns: the valves do what they were told last, and what they do by themselves once that has no life.
    pub fn pass(&mut self, now: u64) {
        let Some((at, order)) = self.last else { return };
        self.gone = now.saturating_sub(at);
        let valid = self.gone.min(self.driven.life);
        self.obey(order, valid);
        let safe = match self.driven.safe {
            Safe::Hold => Order::Hold,
            Safe::Vent => Order::Vent,
        };
        self.obey(safe, self.gone - valid);
    }

    fn obey(&mut self, order: Order, ns: u64) {
        let seconds = ns as f64 * 1e-9;
        match order {
            Order::Follow => {
                let open = self.shaper.openings();
                self.pressure.advance(seconds, open.get(..self.driven.valves).unwrap_or(&open));
            }
            Order::Vent => self.pressure.vent(seconds, self.driven.valves / 2),
            Order::Hold => {}
        }
    }

    /// Takes measured pressures, Pa, for the estimated ones.
    pub fn measure(&mut self, pressures: impl Iterator<Item = f64>) {
        for (bladder, pressure) in pressures.enumerate() {
            self.pressure.correct(bladder, pressure);
        }
    }

    /// Whether a pressure is above its limit.
    #[must_use]
    pub fn is_exceeded(&self) -> bool {
        self.pressure.is_exceeded(self.driven.valves / 2)
    }

    /// Gives an order at `now`, ns, the time that was gone on to. Duties that are asked for count where it is to follow.
    pub fn give(&mut self, now: u64, order: Order, asked: &[f64]) -> Shaped {
        let mut shaped = Shaped::default();
        let is_gap = self.gone > self.driven.life;
        if order != Order::Follow || is_gap {
            // Meanwhile the valves were, or are now, in another state than that of the last duties.
            self.shaper.rest();
        }
        if order == Order::Follow {
            let seconds = if is_gap { self.driven.every } else { self.gone } as f64 * 1e-9;
            let pressure = &self.pressure;
            shaped = self.shaper.shape(asked, seconds, |bladder| pressure.ceiling(bladder));
        }
        shaped.reasons |= if is_gap { Reason::GAP } else { 0 };
        self.last = Some((now, order));
        shaped
    }

    /// The duties that were told last.
    #[must_use]
    pub fn duties(&self) -> &[f32; VALVES] {
        self.shaper.sent()
    }

    /// How many valves there are.
    #[must_use]
    pub fn valves(&self) -> usize {
        self.driven.valves
    }

    /// Pressures over that of the room, Pa; 0 for bladders that there are not.
    #[must_use]
    pub fn pressures(&self) -> [f64; BLADDERS] {
        let counts = |bladder: usize| 2 * bladder < self.driven.valves;
        std::array::from_fn(|i| if counts(i) { self.pressure.pressure(i) } else { 0.0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pressure::PressureParams;
    use crate::shaping::Bounds;

    /// Duty of the first inlet and pressure of its bladder after a tenth of a second in which it was to be half open.
    fn filled(dead_band: f64) -> (f64, f64) {
        let pressure = PressureParams {
            limit: 40e3,
            taper: 4e3,
            start: vec![10e3],
            volume: 0.52e-3,
            doubles_at: 50e3,
            supply: 103e3,
            vacuum: 83e3,
            orifice: 1e-3,
            discharge: 0.8,
        };
        let driven = Driven { valves: 6, safe: Safe::Vent, life: 60_000_000, every: 10_000_000 };
        let bounds = Bounds { greatest: 1.0, slew: 1000.0, dead_band };
        let mut drive = Drive::new(driven, Shaper::new(bounds), PressureEstimator::new(&pressure));
        for tick in 0..=10 {
            drive.pass(tick * 10_000_000);
            drive.give(tick * 10_000_000, Order::Follow, &[0.5, 0.0, 0.0, 0.0, 0.0, 0.0]);
        }
        (f64::from(drive.duties()[0]), drive.pressures()[0])
    }

    #[test]
    fn pressures_are_estimated_from_openings_and_not_from_duties() {
        let (duty, pressure) = filled(0.0);
        let (beyond, same) = filled(0.1);
        assert!((duty - 0.5).abs() < 1e-6 && (beyond - 0.55).abs() < 1e-6, "{duty} {beyond}");
        assert!(pressure > 10.5e3 && (pressure - same).abs() < 1.0, "{pressure} {same}");
    }
}
