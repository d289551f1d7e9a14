//! How far the head is from the reference model: at the time of its pose, and when the orders of this moment act.
//!
//! A pose is `age` old when a law sees it, and an order acts `delay` later. So the pose is compared with the model at the
//! pose's own time, and the error is predicted by what was ordered since (Smith's predictor, SCIENCE Y3):
//!
//! ```text
//! e(t_p) = m(t_p) - y_m(t_p),   e^ = e(t_p) + integral of c from t_p - delay to t
//! c = B v - y_m' - d^
//! ```
//!
//! with `t_p` the time of the pose, `v` the net duties, and `d^` what of them makes up for disturbances, such as the
//! integral of PI: that part moves the head nowhere, so it is no part of the prediction.
//!
//! The position that the orders do not explain, `q(t_p) = e(t_p) - integral of (B v - y_m') up to t_p - delay`, is what the
//! patient does. Its periodic part is learned, if that is asked for, and the speed that a law is to order is y_m' less the
//! speed of this part.

use crate::effect::Decoupling;
use crate::harmonic::{CHANNELS, Position};
use crate::past::Past;
use crate::periodic::Periodic;
use crate::reference::ReferenceModel;

/// What a law is to bring to zero, and the speed that it is to have. One number for each channel, in scales and seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Errors<'a> {
    /// e(t_p), at the time of the pose.
    pub seen: &'a [f64],
    /// e^, when an order of this moment acts.
    pub predicted: &'a [f64],
    /// The speed to order: y_m' when an order of this moment acts, less that of the patient's periodic motion.
    pub speed: &'a [f64],
}

/// The reference model, its past, and what was ordered.
#[derive(Clone, Debug, PartialEq)]
pub struct Tracking {
    model: ReferenceModel,
    delay: f64,
    clock: f64,
    past: Past,
    seen: [f64; CHANNELS],
    predicted: [f64; CHANNELS],
    speed: [f64; CHANNELS],
    /// y_m when an order of this moment acts.
    ahead: [f64; CHANNELS],
    periodic: Option<Periodic>,
    /// Speed of the periodic motion when an order of this moment acts.
    motion: [f64; CHANNELS],
}

impl Tracking {
    /// Of a model, for orders that act `delay` seconds after they are given.
    #[must_use]
    pub fn new(model: ReferenceModel, delay: f64) -> Self {
        Self {
            model,
            delay,
            clock: 0.0,
            past: Past::default(),
            seen: [0.0; CHANNELS],
            predicted: [0.0; CHANNELS],
            speed: [0.0; CHANNELS],
            ahead: [0.0; CHANNELS],
            periodic: None,
            motion: [0.0; CHANNELS],
        }
    }

    /// The same, and it learns the periodic motion of the patient, which is answered in these coordinates.
    #[must_use]
    pub fn with_periodic(self, decoupling: Decoupling) -> Self {
        let channels = self.model.at().len();
        Self { periodic: Some(Periodic::new(channels, decoupling)), ..self }
    }

    /// The periodic motion, if it is learned.
    #[must_use]
    pub fn periodic(&self) -> Option<&Periodic> {
        self.periodic.as_ref()
    }

    /// Goes on with another pole of the reference model, 1/s.
    pub fn set_pole(&mut self, pole: f64) {
        self.model.set_pole(pole);
    }

    /// Puts the model where the head is, and forgets what was ordered.
    pub fn restart(&mut self, pose: &[f64]) {
        self.model.start_at(pose);
        self.clock = 0.0;
        self.past.clear();
        self.past.look(self.clock, self.model.at());
        if let Some(periodic) = &mut self.periodic {
            periodic.restart();
        }
    }

    /// Goes on by `dt` seconds towards a target, and compares a pose that is `age` seconds old.
    pub fn look(&mut self, pose: &[f64], age: f64, target: &[f64], dt: f64) {
        self.model.advance(target, dt);
        self.clock += dt;
        self.past.look(self.clock, self.model.at());
        let then = self.clock - age.max(0.0);
        let pole = self.model.pole();
        // From here until the order acts the model goes on towards the same target; an infinite pole is there already.
        let left = if pole.is_finite() { libm::exp(-pole * self.delay) } else { 0.0 };
        for i in 0..pose.len() {
            self.seen[i] = pose[i] - self.past.model_at(then, i);
            self.predicted[i] = self.seen[i] + self.past.corrected_since(then - self.delay, self.clock, i);
            let distance = (target[i] - self.model.at()[i]) * left;
            self.speed[i] = if pole.is_finite() { pole * distance } else { 0.0 };
            self.ahead[i] = target[i] - distance;
        }
        self.learn(then, dt);
    }

    /// Learns from the pose of a time, and takes the speed of the periodic motion off the speed to order.
    fn learn(&mut self, then: f64, dt: f64) {
        let n = self.model.at().len();
        let Some(periodic) = &mut self.periodic else { return };
        let mut position = Position { time: then, ..Position::default() };
        for i in 0..n {
            position.value[i] = self.seen[i] - self.past.ordered_until(then - self.delay, i);
            position.model[i] = self.past.model_at(then, i);
        }
        periodic.see(position, &self.seen);
        periodic.search(dt);
        periodic.rates(self.clock + self.delay, &mut self.motion);
        for (speed, motion) in self.speed.iter_mut().zip(&self.motion) {
            *speed -= motion;
        }
    }

    /// Takes notice of what was ordered after the last look: the rates `moved` of the channels by the net duties, and
    /// the part of them that makes up for disturbances.
    pub fn acted(&mut self, moved: &[f64], compensation: &[f64]) {
        for (i, (moved, compensation)) in moved.iter().zip(compensation).enumerate() {
            let excess = moved - self.speed[i];
            self.past.order(i, excess - compensation, excess - self.motion[i]);
        }
    }

    /// What the last look found.
    #[must_use]
    pub fn errors(&self) -> Errors<'_> {
        let n = self.model.at().len();
        Errors { seen: &self.seen[..n], predicted: &self.predicted[..n], speed: &self.speed[..n] }
    }

    #[must_use]
    pub fn model(&self) -> &[f64] {
        self.model.at()
    }

    /// y_m when an order of this moment acts.
    #[must_use]
    pub fn ahead(&self) -> &[f64] {
        &self.ahead[..self.model.at().len()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect::Effect;
    use crate::reference::pole_of_rise;

    /// A channel that integrates what is ordered `delay` s later, seen `age` s late, held by `-gain` times an error.
    /// Returns the greatest distance from the model in the last 5 s of 40.
    fn worst(gain: f64, reported: (f64, f64), of: impl Fn(&Errors<'_>) -> f64) -> f64 {
        let (dt, age, delay) = (0.01, 10, 10);
        let mut tracking = Tracking::new(ReferenceModel::new(pole_of_rise(3.0), 1), reported.1);
        tracking.restart(&[0.0]);
        let (mut poses, mut orders, mut model) = (vec![0.2], vec![], vec![]);
        for k in 0..4000_usize {
            let pose = poses[k.saturating_sub(age)];
            tracking.look(&[pose], reported.0, &[1.0], dt);
            let errors = tracking.errors();
            let rate = errors.speed[0] - gain * of(&errors);
            orders.push(rate);
            model.push(tracking.model()[0]);
            tracking.acted(&[rate], &[0.0]);
            let acting = if k >= delay { orders[k - delay] } else { 0.0 };
            poses.push(poses[k] + acting * dt);
        }
        (3500..4000).map(|k| f64::abs(poses[k] - model[k])).fold(0.0, f64::max)
    }

    #[test]
    fn a_gain_that_swings_on_late_poses_is_calm_on_the_predicted_error() {
        // 0.2 s of age and delay: a gain of 9 1/s is beyond the limit of pi / 2 / 0.2 s = 7.9 1/s.
        let seen = worst(9.0, (0.1, 0.1), |e| e.seen[0]);
        let predicted = worst(9.0, (0.1, 0.1), |e| e.predicted[0]);
        assert!(seen > 1.0, "{seen}");
        assert!(predicted < 1e-3, "{predicted}");
        // Told half of the age and the delay, it still holds.
        let half = worst(9.0, (0.05, 0.05), |e| e.predicted[0]);
        assert!(half < 1e-3, "{half}");
    }

    #[test]
    fn the_error_is_that_of_the_poses_own_time() {
        let pole = pole_of_rise(2.0);
        let mut tracking = Tracking::new(ReferenceModel::new(pole, 1), 0.0);
        tracking.restart(&[0.0]);
        let at = |t: f64| -libm::expm1(-pole * t);
        for k in 1..=300_u32 {
            let t = 0.01 * f64::from(k);
            // A head that follows the model exactly, seen 0.255 s late.
            let pose = at((t - 0.255_f64).max(0.0));
            tracking.look(&[pose], 0.255, &[1.0], 0.01);
            assert!(tracking.errors().seen[0].abs() < 1e-4, "{t}: {:?}", tracking.errors());
        }
        let errors = tracking.errors();
        assert!((errors.speed[0] - pole * (1.0 - at(3.0))).abs() < 1e-9, "{errors:?}");
    }

    #[test]
    fn what_makes_up_for_a_disturbance_is_not_predicted() {
        let mut tracking = Tracking::new(ReferenceModel::new(1.0, 1), 0.05);
        tracking.restart(&[0.0]);
        for _ in 0..20 {
            tracking.look(&[0.0], 0.1, &[0.0], 0.01);
            // An order of 0.3 /s against a drift of -0.3 /s.
            tracking.acted(&[0.3], &[0.3]);
        }
        assert!(tracking.errors().predicted[0].abs() < 1e-12, "{:?}", tracking.errors());
        for _ in 0..20 {
            tracking.look(&[0.0], 0.1, &[0.0], 0.01);
            tracking.acted(&[0.3], &[0.0]);
        }
        tracking.look(&[0.0], 0.1, &[0.0], 0.01);
        // 0.15 s of orders are not seen yet.
        assert!((tracking.errors().predicted[0] - 0.3 * 0.15).abs() < 1e-9, "{:?}", tracking.errors());
    }

    /// Holds a channel with PI against a motion of the patient, with orders of this effect, seen every 100 ms and 20 ms
    /// late. Returns the greatest error of the last 10 s.
    fn held(seconds: f64, effect: f64, motion: impl Fn(f64) -> f64) -> f64 {
        let unit = Effect::new(nalgebra::DMatrix::identity(1, 1)).unwrap();
        let model = ReferenceModel::new(pole_of_rise(3.0), 1);
        let mut tracking = Tracking::new(model, 0.02).with_periodic(unit.decoupling());
        tracking.restart(&[0.0]);
        let (dt, mut ordered, mut integral, mut worst) = (0.02, 0.0, 0.0, 0.0_f64);
        let (mut pose, mut taken, mut orders) = (0.0, 0.0, vec![0.0]);
        for k in 0..(seconds / dt) as usize {
            let time = dt * k as f64;
            let here = motion(time) + effect * ordered;
            if k % 5 == 1 {
                (pose, taken) =
                    (motion(time - dt) + effect * (ordered - dt * orders[orders.len() - 2]), time - dt);
            }
            tracking.look(&[pose], time - taken, &[0.0], if k == 0 { 0.0 } else { dt });
            let errors = tracking.errors();
            integral += dt * errors.seen[0];
            let rate = errors.speed[0] - 2.37 * errors.predicted[0] - 2.55 * integral;
            tracking.acted(&[rate], &[-2.55 * integral]);
            orders.push(rate);
            ordered += dt * orders[orders.len() - 2];
            worst = if time > seconds - 10.0 { worst.max(here.abs()) } else { 0.0 };
        }
        worst
    }

    #[test]
    fn a_breath_is_held_by_a_law_that_knows_it() {
        let breath = |t: f64| 0.026 * (core::f64::consts::TAU * 0.25 * t).sin();
        let found = held(60.0, 1.0, breath);
        assert!(found < 0.002, "{found}");
        let weak = held(90.0, 0.7, breath);
        assert!(weak < 0.004, "{weak}");
    }

    #[test]
    fn two_looks_at_one_time_are_one_and_a_long_past_is_cut() {
        let mut tracking = Tracking::new(ReferenceModel::new(1.0, 2), 0.0);
        tracking.restart(&[1.0, 2.0]);
        for k in 0..1000 {
            tracking.look(&[1.0, 2.0], 5.0, &[1.0, 2.0], if k % 2 == 0 { 0.01 } else { 0.0 });
            tracking.acted(&[1.0, f64::from(k % 2)], &[0.0, 0.0]);
        }
        assert_eq!(tracking.past.known(), crate::past::LOOKS);
        let errors = tracking.errors();
        assert!(errors.seen.iter().all(|e| e.abs() < 1e-12), "{errors:?}");
        // Of each pair the second order stands: 0.01 s each over what is remembered.
        let predicted = [errors.predicted[0], errors.predicted[1]];
        assert!((predicted[0] - predicted[1]).abs() < 0.011, "{predicted:?}");
    }
}
