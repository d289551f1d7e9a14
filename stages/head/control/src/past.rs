//! What the reference model and the orders were in the last second, by which poses that come late are judged.

use crate::harmonic::CHANNELS;

/// Looks that are remembered: more than a second at a look every 10 ms. Poses older than that are compared with the
/// oldest.
pub const LOOKS: usize = 128;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Moment {
    /// s since the restart.
    at: f64,
    model: [f64; CHANNELS],
    /// c, from this look to the next.
    correction: [f64; CHANNELS],
    /// B v - y_m' from this look to the next, and its integral from the restart to this look.
    order: [f64; CHANNELS],
    ordered: [f64; CHANNELS],
}

/// The last looks of a law.
#[derive(Clone, Debug, PartialEq)]
pub struct Past {
    moments: Box<[Moment; LOOKS]>,
    /// Of `moments`, those that are there, and the place of the newest.
    known: usize,
    newest: usize,
}

impl Default for Past {
    fn default() -> Self {
        Self { moments: Box::new([Moment::default(); LOOKS]), known: 0, newest: 0 }
    }
}

impl Past {
    pub fn clear(&mut self) {
        self.known = 0;
    }

    /// Number of looks that are remembered.
    #[cfg(test)]
    pub fn known(&self) -> usize {
        self.known
    }

    /// Takes a look at a time, with the model of this time. Two looks at one time are one: the later order stands.
    pub fn look(&mut self, at: f64, model: &[f64]) {
        let mut ordered = self.moments[self.newest].ordered;
        if self.known == 0 {
            ordered = [0.0; CHANNELS];
        }
        if self.known == 0 || self.moments[self.newest].at < at {
            let before = &self.moments[self.newest];
            if self.known > 0 {
                ordered = core::array::from_fn(|i| ordered[i] + before.order[i] * (at - before.at));
            }
            self.newest = (self.newest + 1) % LOOKS;
            self.known = (self.known + 1).min(LOOKS);
        }
        let moment = &mut self.moments[self.newest];
        *moment = Moment { at, ordered, ..Moment::default() };
        moment.model[..model.len()].copy_from_slice(model);
    }

    /// Says what is ordered from the last look on: c and B v - y_m' of a channel.
    pub fn order(&mut self, channel: usize, correction: f64, order: f64) {
        let moment = &mut self.moments[self.newest];
        (moment.correction[channel], moment.order[channel]) = (correction, order);
    }

    /// The looks, newest first.
    fn back(&self) -> impl Iterator<Item = &Moment> {
        (0..self.known).map(|k| &self.moments[(self.newest + LOOKS - k) % LOOKS])
    }

    /// The model at a time: between two looks on the straight line.
    #[must_use]
    pub fn model_at(&self, time: f64, channel: usize) -> f64 {
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
    #[must_use]
    pub fn ordered_until(&self, time: f64, channel: usize) -> f64 {
        let mut oldest = 0.0;
        for moment in self.back() {
            if moment.at <= time {
                return moment.ordered[channel] + moment.order[channel] * (time - moment.at);
            }
            oldest = moment.ordered[channel];
        }
        oldest
    }

    /// The integral of c from a time until now.
    #[must_use]
    pub fn corrected_since(&self, time: f64, now: f64, channel: usize) -> f64 {
        let (mut sum, mut until) = (0.0, now);
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

    #[test]
    fn orders_add_up_and_what_is_forgotten_stays_in_their_sum() {
        let mut past = Past::default();
        for k in 0..1000_u32 {
            past.look(0.01 * f64::from(k), &[0.1 * f64::from(k)]);
            past.order(0, 2.0, 1.0);
        }
        let now = 9.99;
        assert_eq!(past.known(), LOOKS);
        assert!((past.ordered_until(now, 0) - now).abs() < 1e-9);
        assert!((past.ordered_until(9.5, 0) - 9.5).abs() < 1e-9);
        assert!((past.corrected_since(9.5, now, 0) - 0.98).abs() < 1e-9);
        assert!((past.model_at(9.505, 0) - 95.05).abs() < 1e-9);
        // Beyond what is remembered the oldest look stands.
        let oldest = now - 0.01 * (LOOKS - 1) as f64;
        assert!((past.ordered_until(1.0, 0) - oldest).abs() < 1e-9);
        past.clear();
        past.look(20.0, &[7.0]);
        assert_eq!((past.known(), past.model_at(3.0, 0), past.ordered_until(20.0, 0)), (1, 7.0, 0.0));
    }
}
