//! The reference model (4.24): how a controlled pose is to approach its target, y_m' = -a (y_m - y_des).

/// A pole for every channel.
#[derive(Clone, Debug, PartialEq)]
pub struct ReferenceModel {
    pole: f64,
    at: Vec<f64>,
}

/// The pole a, 1/s, at which a step takes `seconds` from 10 % to 90 % of its way: a = ln 9 / seconds (SCIENCE E5).
/// Infinite for 0 s.
#[must_use]
pub fn pole_of_rise(seconds: f64) -> f64 {
    libm::log(9.0) / seconds
}

impl ReferenceModel {
    /// A model with this pole, 1/s, which may be infinite, for this many channels. It starts at zero.
    #[must_use]
    pub fn new(pole: f64, channels: usize) -> Self {
        Self { pole, at: vec![0.0; channels] }
    }

    /// The pole a, 1/s.
    #[must_use]
    pub fn pole(&self) -> f64 {
        self.pole
    }

    /// Goes on with another pole from where it is.
    pub fn set_pole(&mut self, pole: f64) {
        self.pole = pole;
    }

    /// Puts the model where the plant is.
    pub fn start_at(&mut self, y: &[f64]) {
        self.at.copy_from_slice(y);
    }

    /// Moves it by `dt` seconds towards a target that stands meanwhile: exact for any `dt`.
    pub fn advance(&mut self, target: &[f64], dt: f64) {
        let part = -libm::expm1(-self.pole * dt);
        for (at, target) in self.at.iter_mut().zip(target) {
            // An infinite pole is at its target at once, before any time has gone by.
            *at = if self.pole.is_finite() { *at + part * (target - *at) } else { *target };
        }
    }

    #[must_use]
    pub fn at(&self) -> &[f64] {
        &self.at
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_steps_and_one_great_step_arrive_at_the_same_place() {
        let mut small = ReferenceModel::new(pole_of_rise(20.0), 2);
        let mut great = small.clone();
        for _ in 0..1000 {
            small.advance(&[1.0, -2.0], 0.01);
        }
        great.advance(&[1.0, -2.0], 10.0);
        for (a, b) in small.at().iter().zip(great.at()) {
            assert!((a - b).abs() < 1e-12, "{a} {b}");
        }
    }

    #[test]
    fn without_a_rise_time_it_is_at_its_target_at_once() {
        let mut model = ReferenceModel::new(pole_of_rise(0.0), 1);
        model.advance(&[3.0], 0.0);
        assert_eq!(model.at(), [3.0]);
    }
}
