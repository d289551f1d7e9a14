//! Proportional and integral control of each channel through the inverse of the bladders' effect: the baseline.

use crate::effect::Effect;
use crate::valves::clip;

/// Gains, the same for every channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PiGains {
    /// Rate of a channel per error, 1/s.
    pub proportional: f64,
    /// Rate of a channel per integrated error, 1/s2.
    pub integral: f64,
}

/// v = B^-1 (k_p e + k_i int e), with e the target less the pose.
#[derive(Clone, Debug)]
pub struct Pi {
    gains: PiGains,
    effect: Effect,
    /// Integral of the error, in scales times seconds.
    integral: Vec<f64>,
    before: Vec<f64>,
    rates: Vec<f64>,
}

impl Pi {
    /// A law with integrators of zero.
    #[must_use]
    pub fn new(gains: PiGains, effect: Effect) -> Self {
        let zeros = vec![0.0; effect.channels()];
        Self { gains, effect, integral: zeros.clone(), before: zeros.clone(), rates: zeros }
    }

    /// The integral of the error of each channel, in scales times seconds.
    #[must_use]
    pub fn integral(&self) -> &[f64] {
        &self.integral
    }

    /// Clears the integrators.
    pub fn restart(&mut self) {
        self.integral.fill(0.0);
    }

    /// Uses the pose `y` and the set-point `r`, `dt` seconds after the last step, and leaves net duties in `net`, within
    /// -1 to 1. The integrals stand still where going on would only ask more of a valve that is wide open.
    pub fn step(&mut self, y: &[f64], r: &[f64], dt: f64, net: &mut [f64]) {
        self.before.copy_from_slice(&self.integral);
        for (integral, (y, r)) in self.integral.iter_mut().zip(y.iter().zip(r)) {
            *integral += dt * (r - y);
        }
        let going_on = self.demand(y, r, net);
        std::mem::swap(&mut self.integral, &mut self.before);
        let standing = self.demand(y, r, net);
        if going_on <= standing {
            std::mem::swap(&mut self.integral, &mut self.before);
            self.demand(y, r, net);
        }
    }

    /// The duties of the present integrals; returns how far beyond the limits they were.
    fn demand(&mut self, y: &[f64], r: &[f64], net: &mut [f64]) -> f64 {
        for (i, rate) in self.rates.iter_mut().enumerate() {
            *rate = self.gains.proportional * (r[i] - y[i]) + self.gains.integral * self.integral[i];
        }
        self.effect.duties(&self.rates, net);
        clip(net)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;

    fn law(rate: f64) -> Pi {
        let effect = Effect::new(DMatrix::from_element(1, 1, rate)).unwrap();
        Pi::new(PiGains { proportional: 1.0, integral: 0.15 }, effect)
    }

    #[test]
    fn a_constant_drift_is_made_up_for() {
        let (mut law, mut y, mut net) = (law(0.5), 0.0, [0.0]);
        for _ in 0..1000 {
            law.step(&[y], &[1.0], 0.1, &mut net);
            y += 0.1 * (0.5 * net[0] - 0.05);
        }
        assert!((y - 1.0).abs() < 1e-6, "{y}");
    }

    #[test]
    fn a_target_far_away_does_not_wind_the_integral_up() {
        let (mut law, mut y, mut net, mut highest) = (law(0.1), 0.0, [0.0], 0.0_f64);
        for _ in 0..2000 {
            law.step(&[y], &[5.0], 0.1, &mut net);
            y += 0.1 * 0.1 * net[0];
            highest = highest.max(y);
        }
        assert!(highest < 5.8 && (y - 5.0).abs() < 1e-3, "highest {highest}, at last {y}");
    }
}
