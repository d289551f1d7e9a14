//! Proportional and integral control of each channel through the inverse of the bladders' effect: the baseline.

use crate::effect::Effect;
use crate::tracking::Errors;
use crate::valves::clip;

/// Gains, the same for every channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PiGains {
    /// Rate of a channel per error, 1/s.
    pub proportional: f64,
    /// Rate of a channel per integrated error, 1/s2.
    pub integral: f64,
}

/// v = B^-1 (y_m' - k_p e^ - k_i int e), where e is the pose minus the reference model, e^ is the predicted error, and y_m'
/// is the speed to order ([`Errors`]).
#[derive(Clone, Debug)]
pub struct Pi {
    gains: PiGains,
    effect: Effect,
    /// Integral of the target less the pose, in scales times seconds.
    integral: Vec<f64>,
    before: Vec<f64>,
    rates: Vec<f64>,
    compensation: Vec<f64>,
}

impl Pi {
    /// Makes a law whose integrators are zero.
    #[must_use]
    pub fn new(gains: PiGains, effect: Effect) -> Self {
        let zeros = vec![0.0; effect.channels()];
        Self {
            gains,
            effect,
            integral: zeros.clone(),
            before: zeros.clone(),
            rates: zeros.clone(),
            compensation: zeros,
        }
    }

    /// The integral of the target less the pose of each channel, in scales times seconds.
    #[must_use]
    pub fn integral(&self) -> &[f64] {
        &self.integral
    }

    /// Goes on with other gains. What the integrals demand stays, so that no valve jumps by it.
    pub fn set_gains(&mut self, gains: PiGains) {
        let scale = if gains.integral > 0.0 { self.gains.integral / gains.integral } else { 0.0 };
        self.integral.iter_mut().for_each(|integral| *integral *= scale);
        self.gains = gains;
    }

    pub fn restart(&mut self) {
        self.integral.fill(0.0);
    }

    /// Computes net duties from the errors and writes them into `net`, within -1 to 1. `dt` is the time since the last
    /// step, s. The integrals do not change if the change would only demand more of a fully open valve.
    pub fn step(&mut self, errors: &Errors<'_>, dt: f64, net: &mut [f64]) {
        self.before.copy_from_slice(&self.integral);
        for (integral, seen) in self.integral.iter_mut().zip(errors.seen) {
            *integral -= dt * seen;
        }
        let going_on = self.demand(errors, net);
        std::mem::swap(&mut self.integral, &mut self.before);
        let standing = self.demand(errors, net);
        if going_on <= standing {
            std::mem::swap(&mut self.integral, &mut self.before);
            self.demand(errors, net);
        }
    }

    /// Returns the rates of the channels at these net duties, and the part of the rates that the integrals demand.
    pub fn moved(&mut self, net: &[f64]) -> [&[f64]; 2] {
        self.effect.moved(net, &mut self.rates);
        for (compensation, integral) in self.compensation.iter_mut().zip(&self.integral) {
            *compensation = self.gains.integral * integral;
        }
        [&self.rates, &self.compensation]
    }

    /// Writes the duties of the present integrals, and returns the sum of the squares by which they exceeded the limits.
    fn demand(&mut self, errors: &Errors<'_>, net: &mut [f64]) -> f64 {
        for (i, rate) in self.rates.iter_mut().enumerate() {
            *rate = errors.speed[i] - self.gains.proportional * errors.predicted[i]
                + self.gains.integral * self.integral[i];
        }
        self.effect.duties(&self.rates, net);
        clip(net)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;

    /// Steps the law with a pose without delay and a constant set-point.
    fn step(law: &mut Pi, y: f64, r: f64, net: &mut [f64]) {
        let error = [y - r];
        law.step(&Errors { seen: &error, predicted: &error, speed: &[0.0] }, 0.1, net);
    }

    fn law(rate: f64) -> Pi {
        let effect = Effect::new(DMatrix::from_element(1, 1, rate)).unwrap();
        Pi::new(PiGains { proportional: 1.0, integral: 0.15 }, effect)
    }

    #[test]
    fn the_integral_compensates_a_constant_drift() {
        let (mut law, mut y, mut net) = (law(0.5), 0.0, [0.0]);
        for _ in 0..1000 {
            step(&mut law, y, 1.0, &mut net);
            y += 0.1 * (0.5 * net[0] - 0.05);
        }
        assert!((y - 1.0).abs() < 1e-6, "{y}");
    }

    #[test]
    fn other_gains_leave_the_demand_of_the_integrals_as_it_is() {
        let (mut law, mut net) = (law(0.5), [0.0]);
        (0..10).for_each(|_| step(&mut law, 0.0, 0.01, &mut net));
        let before = law.gains.integral * law.integral()[0];
        law.set_gains(PiGains { proportional: 2.0, integral: 0.3 });
        assert!(before > 0.0 && (law.gains.integral * law.integral()[0] - before).abs() < 1e-15);
        law.set_gains(PiGains { proportional: 2.0, integral: 0.0 });
        law.set_gains(PiGains { proportional: 2.0, integral: 0.15 });
        assert_eq!(law.integral(), [0.0]);
    }

    #[test]
    fn a_distant_target_does_not_wind_up_the_integral() {
        let (mut law, mut y, mut net, mut highest) = (law(0.1), 0.0, [0.0], 0.0_f64);
        for _ in 0..2000 {
            step(&mut law, y, 5.0, &mut net);
            y += 0.1 * 0.1 * net[0];
            highest = highest.max(y);
        }
        assert!(highest < 5.8 && (y - 5.0).abs() < 1e-3, "highest {highest}, at last {y}");
    }
}
