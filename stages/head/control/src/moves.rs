//! A target that moves from place to place: steps, ramps and trajectories of them.

use stillpoint_operator::Choice;

/// How a move goes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Choice)]
pub enum Profile {
    /// At one speed.
    #[default]
    Linear,
    /// From rest to rest, with the least jerk: 10 s^3 - 15 s^4 + 6 s^5.
    Smooth,
}

/// A move of up to six channels, from where they are to where they are to be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leg {
    /// When it begins, ns.
    pub begin: u64,
    /// How long it takes, ns; 0 for a step.
    pub over: u64,
    /// Profile of the motion over time.
    pub profile: Profile,
    /// Pose at the begin.
    pub from: [f64; 6],
    /// Pose at the end.
    pub to: [f64; 6],
}

impl Leg {
    /// A leg that rests.
    #[must_use]
    pub fn resting(at: [f64; 6]) -> Self {
        Self { begin: 0, over: 0, profile: Profile::Linear, from: at, to: at }
    }

    /// Places and rates (per second) at a time, ns.
    #[must_use]
    pub fn at(&self, time: u64) -> ([f64; 6], [f64; 6]) {
        let gone = time.saturating_sub(self.begin);
        if gone >= self.over {
            return (self.to, [0.0; 6]);
        }
        let s = gone as f64 / self.over as f64;
        let (part, rate) = match self.profile {
            Profile::Linear => (s, 1.0),
            Profile::Smooth => {
                (s * s * s * (10.0 + s * (6.0 * s - 15.0)), 30.0 * s * s * (1.0 - s) * (1.0 - s))
            }
        };
        let rate = rate / (self.over as f64 * 1e-9);
        let span = |i: usize| self.to[i] - self.from[i];
        (std::array::from_fn(|i| self.from[i] + part * span(i)), std::array::from_fn(|i| rate * span(i)))
    }

    /// Whether it is under way.
    #[must_use]
    pub fn is_moving(&self, time: u64) -> bool {
        time.saturating_sub(self.begin) < self.over && self.from != self.to
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn leg(profile: Profile) -> Leg {
        Leg { begin: 1_000_000_000, over: 2_000_000_000, profile, from: [1.0; 6], to: [3.0; 6] }
    }

    #[test]
    fn a_ramp_has_one_speed() {
        let ramp = leg(Profile::Linear);
        assert_eq!(ramp.at(1_500_000_000), ([1.5; 6], [1.0; 6]));
        assert_eq!(ramp.at(3_000_000_000), ([3.0; 6], [0.0; 6]));
        assert!(ramp.is_moving(2_999_999_999) && !ramp.is_moving(3_000_000_000));
    }

    #[test]
    fn a_smooth_move_begins_and_ends_at_rest_and_its_rates_are_those_of_its_places() {
        let smooth = leg(Profile::Smooth);
        assert_eq!((smooth.at(1_000_000_000).0, smooth.at(1_000_000_000).1), ([1.0; 6], [0.0; 6]));
        assert_eq!(smooth.at(2_000_000_000).0, [2.0; 6]);
        for t in [1_200_000_000, 1_900_000_000, 2_800_000_000] {
            let (before, after) = (smooth.at(t - 1_000_000).0[0], smooth.at(t + 1_000_000).0[0]);
            assert!((smooth.at(t).1[0] - (after - before) / 0.002).abs() < 1e-4);
        }
    }

    #[test]
    fn a_step_is_there_at_once() {
        let step = Leg { over: 0, ..leg(Profile::Linear) };
        assert_eq!(step.at(1_000_000_000).0, [3.0; 6]);
    }
}
