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

use crate::harmonic::{CHANNELS, Position};
use crate::periodic::Periodic;
use crate::reference::ReferenceModel;

/// Looks that are remembered: more than a second at a look every 10 ms. Poses older than that are compared with the
/// oldest.
const PAST: usize = 128;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Moment {
    /// s since the restart.
    at: f64,
    /// y_m.
    model: [f64; CHANNELS],
    /// c, from this look to the next.
    correction: [f64; CHANNELS],
    /// B v - y_m' from this look to the next, and its integral from the restart to this look.
    order: [f64; CHANNELS],
    ordered: [f64; CHANNELS],
}

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
    past: Box<[Moment; PAST]>,
    /// Of `past`, the moments that are there, and the place of the newest.
    known: usize,
    newest: usize,
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
            past: Box::new([Moment::default(); PAST]),
            known: 0,
            newest: 0,
            seen: [0.0; CHANNELS],
            predicted: [0.0; CHANNELS],
            speed: [0.0; CHANNELS],
            ahead: [0.0; CHANNELS],
            periodic: None,
            motion: [0.0; CHANNELS],
        }
    }

    /// The same, and it learns the periodic motion of the patient.
    #[must_use]
    pub fn with_periodic(self) -> Self {
        let channels = self.model.at().len();
        Self { periodic: Some(Periodic::new(channels)), ..self }
    }

    /// The periodic motion, if it is learned.
    #[must_use]
    pub fn periodic(&self) -> Option<&Periodic> {
        self.periodic.as_ref()
    }

    /// Puts the model where the head is, and forgets what was ordered.
    pub fn restart(&mut self, pose: &[f64]) {
        self.model.start_at(pose);
        self.clock = 0.0;
        self.known = 0;
        self.remember();
        if let Some(periodic) = &mut self.periodic {
            periodic.restart();
        }
    }

    /// Goes on by `dt` seconds towards a target, and compares a pose that is `age` seconds old.
    pub fn look(&mut self, pose: &[f64], age: f64, target: &[f64], dt: f64) {
        self.model.advance(target, dt);
        self.clock += dt;
        self.remember();
        let then = self.clock - age.max(0.0);
        let pole = self.model.pole();
        // From here until the order acts the model goes on towards the same target; an infinite pole is there already.
        let left = if pole.is_finite() { libm::exp(-pole * self.delay) } else { 0.0 };
        for i in 0..pose.len() {
            self.seen[i] = pose[i] - self.model_at(then, i);
            self.predicted[i] = self.seen[i] + self.ordered_since(then - self.delay, i);
            let way = (target[i] - self.model.at()[i]) * left;
            self.speed[i] = if pole.is_finite() { pole * way } else { 0.0 };
            self.ahead[i] = target[i] - way;
        }
        self.learn(then, dt);
    }

    /// Learns from the pose of a time, and takes the speed of the periodic motion off the speed to order.
    fn learn(&mut self, then: f64, dt: f64) {
        let n = self.model.at().len();
        let mut position = Position { time: then, ..Position::default() };
        for i in 0..n {
            position.value[i] = self.seen[i] - self.ordered_until(then - self.delay, i);
            position.model[i] = self.model_at(then, i);
        }
        let Some(periodic) = &mut self.periodic else { return };
        periodic.see(position, &self.seen[..n]);
        periodic.search(dt);
        periodic.rates(self.clock + self.delay, &mut self.motion[..n]);
        for (speed, motion) in self.speed.iter_mut().zip(&self.motion) {
            *speed -= motion;
        }
    }

    /// Takes notice of what was ordered after the last look: the rates `moved` of the channels by the net duties, and
    /// the part of them that makes up for disturbances.
    pub fn acted(&mut self, moved: &[f64], compensation: &[f64]) {
        let moment = &mut self.past[self.newest];
        for (i, (moved, compensation)) in moved.iter().zip(compensation).enumerate() {
            moment.correction[i] = moved - self.speed[i] - compensation;
            moment.order[i] = moved - self.speed[i] - self.motion[i];
        }
    }

    /// What the last look found.
    #[must_use]
    pub fn errors(&self) -> Errors<'_> {
        let n = self.model.at().len();
        Errors { seen: &self.seen[..n], predicted: &self.predicted[..n], speed: &self.speed[..n] }
    }

    /// y_m now.
    #[must_use]
    pub fn model(&self) -> &[f64] {
        self.model.at()
    }

    /// y_m when an order of this moment acts.
    #[must_use]
    pub fn ahead(&self) -> &[f64] {
        &self.ahead[..self.model.at().len()]
    }

    fn remember(&mut self) {
        // Two looks at one time are one: the later order stands.
        let mut ordered = self.past[self.newest].ordered;
        if self.known == 0 {
            ordered = [0.0; CHANNELS];
        }
        if self.known == 0 || self.past[self.newest].at < self.clock {
            let before = &self.past[self.newest];
            if self.known > 0 {
                ordered = core::array::from_fn(|i| ordered[i] + before.order[i] * (self.clock - before.at));
            }
            self.newest = (self.newest + 1) % PAST;
            self.known = (self.known + 1).min(PAST);
        }
        let moment = &mut self.past[self.newest];
        *moment = Moment { at: self.clock, ordered, ..Moment::default() };
        moment.model[..self.model.at().len()].copy_from_slice(self.model.at());
    }

    /// The remembered moments, newest first.
    fn back(&self) -> impl Iterator<Item = &Moment> {
        (0..self.known).map(|k| &self.past[(self.newest + PAST - k) % PAST])
    }

    /// The model at a time: between two looks on the straight line.
    fn model_at(&self, time: f64, channel: usize) -> f64 {
        let mut later: Option<&Moment> = None;
        for moment in self.back() {
            if moment.at <= time {
                let here = moment.model[channel];
                return later.map_or(here, |later| {
                    here + (later.model[channel] - here) * (time - moment.at) / (later.at - moment.at)
                });
            }
            later = Some(moment);
        }
        later.map_or(0.0, |oldest| oldest.model[channel])
    }

    /// The integral of B v - y_m' from the restart to a time.
    fn ordered_until(&self, time: f64, channel: usize) -> f64 {
        let mut oldest = 0.0;
        for moment in self.back() {
            if moment.at <= time {
                return moment.ordered[channel] + moment.order[channel] * (time - moment.at);
            }
            oldest = moment.ordered[channel];
        }
        oldest
    }

    /// The integral of c from a time on.
    fn ordered_since(&self, time: f64, channel: usize) -> f64 {
        let (mut sum, mut until) = (0.0, self.clock);
        for moment in self.back() {
            sum += moment.correction[channel] * (until - moment.at.max(time)).max(0.0);
            if moment.at <= time {
                break;
            }
            until = moment.at;
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::pole_of_rise;

    /// A channel that integrates what is ordered `delay` s later, seen `age` s late, held by `-gain` times an error.
    /// Returns the greatest distance from the model in the last 5 s of 40.
    fn worst(gain: f64, told: (f64, f64), of: impl Fn(&Errors<'_>) -> f64) -> f64 {
        let (dt, age, delay) = (0.01, 10, 10);
        let mut tracking = Tracking::new(ReferenceModel::new(pole_of_rise(3.0), 1), told.1);
        tracking.restart(&[0.0]);
        let (mut poses, mut orders, mut model) = (vec![0.2], vec![], vec![]);
        for k in 0..4000_usize {
            let pose = poses[k.saturating_sub(age)];
            tracking.look(&[pose], told.0, &[1.0], dt);
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

    #[test]
    fn two_looks_at_one_time_are_one_and_a_long_past_is_cut() {
        let mut tracking = Tracking::new(ReferenceModel::new(1.0, 2), 0.0);
        tracking.restart(&[1.0, 2.0]);
        for k in 0..1000 {
            tracking.look(&[1.0, 2.0], 5.0, &[1.0, 2.0], if k % 2 == 0 { 0.01 } else { 0.0 });
            tracking.acted(&[1.0, f64::from(k % 2)], &[0.0, 0.0]);
        }
        assert_eq!(tracking.known, PAST);
        let errors = tracking.errors();
        assert!(errors.seen.iter().all(|e| e.abs() < 1e-12), "{errors:?}");
        // Of each pair the second order stands: 0.01 s each over what is remembered.
        let predicted = [errors.predicted[0], errors.predicted[1]];
        assert!((predicted[0] - predicted[1]).abs() < 0.011, "{predicted:?}");
    }
}
