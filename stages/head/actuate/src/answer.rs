//! Watchdogs of the head's answer to orders: an error from the reference model that lasts, a pressure estimate that
//! limits an inlet while there is such an error, and orders that have no effect.
//!
//! Orders that are lost on the way, a supply without air, leaks and stuck valves all show here: the pose and the commands
//! are fresh, and the head still does not go where it is told.

use stillpoint_operator::Params;
use stillpoint_samples::{ActuationReason as Reason, ActuationState};

/// Time without an error counts back at this part of the speed at which time with an error counts.
const FADES: u64 = 4;

/// For how long the head may fail to answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Params)]
pub struct AnswerParams {
    /// Time for which the controller may report a tracking error before this is a fault. Short errors add up if there is
    /// one for more than a fifth of the time.
    #[param(unit = "ns", default = "4 s", min = "10 ms", max = "10 min")]
    pub error_patience: u64,
    /// Time for which the pressure estimate may limit an inlet during a tracking error before this is a fault, counted in
    /// the same way. Not used while pressures are measured.
    #[param(unit = "ns", default = "1 s", min = "10 ms", max = "10 min")]
    pub pressure_patience: u64,
    /// Time for which a bladder may push with less than the least force before this is a fault, counted in the same
    /// way. It is used if `contacts` is connected.
    #[param(unit = "ns", default = "2 s", min = "10 ms", max = "10 min")]
    pub contact_patience: u64,
    /// Time for which the controller may report orders without effect before this is a fault, counted in the same way:
    /// the estimate of a pressure follows orders, so it is wrong. Not used while pressures are measured.
    #[param(unit = "ns", default = "2 s", min = "10 ms", max = "10 min")]
    pub effect_patience: u64,
}

/// What one look at the head's answer finds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Answered {
    /// The controller reports a tracking error.
    pub error: bool,
    /// The estimate of a pressure limits an inlet.
    pub limited: bool,
    /// A bladder pushes with less than the least force.
    pub loose: bool,
    /// The controller reports orders without effect, and no pressure is measured.
    pub without_effect: bool,
}

/// Counts for how long the head has not answered.
#[derive(Clone, Debug)]
pub struct AnswerWatch {
    params: AnswerParams,
    looked: Option<u64>,
    error: u64,
    limited: u64,
    loose: u64,
    without_effect: u64,
}

impl AnswerWatch {
    /// A watch that has seen nothing.
    #[must_use]
    pub fn new(params: AnswerParams) -> Self {
        Self { params, looked: None, error: 0, limited: 0, loose: 0, without_effect: 0 }
    }

    /// Looks at `now`, ns, in this state of actuation, and returns the faults as bits of [`Reason`].
    ///
    /// Time counts while commands are followed. A hold stops the count, and every other state clears it.
    pub fn look(&mut self, now: u64, state: ActuationState, answered: Answered) -> u32 {
        let gone = self.looked.replace(now).map_or(0, |looked| now.saturating_sub(looked));
        match state {
            ActuationState::Armed => {
                count(&mut self.error, gone, answered.error);
                count(&mut self.limited, gone, answered.error && answered.limited);
                count(&mut self.loose, gone, answered.loose);
                count(&mut self.without_effect, gone, answered.without_effect);
            }
            ActuationState::Holding => {}
            ActuationState::Disarmed | ActuationState::Venting | ActuationState::Fault => {
                *self = Self { looked: self.looked, ..Self::new(self.params) };
            }
        }
        let bit = |holds: bool, reason: u32| if holds { reason } else { 0 };
        bit(self.error >= self.params.error_patience, Reason::TRACKING_ERROR)
            | bit(self.loose >= self.params.contact_patience, Reason::CONTACT_LOW)
            | bit(self.without_effect >= self.params.effect_patience, Reason::NO_EFFECT)
            | bit(
                self.limited >= self.params.pressure_patience,
                Reason::PRESSURE_DOUBTED | Reason::TRACKING_ERROR,
            )
    }
}

fn count(time: &mut u64, gone: u64, holds: bool) {
    *time = if holds { time.saturating_add(gone) } else { time.saturating_sub(gone / FADES) };
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;
    const RULES: AnswerParams = AnswerParams {
        error_patience: 4000 * MS,
        pressure_patience: 1000 * MS,
        contact_patience: 2000 * MS,
        effect_patience: 2000 * MS,
    };
    const WELL: Answered = Answered { error: false, limited: false, loose: false, without_effect: false };
    const ERROR: Answered = Answered { error: true, ..WELL };
    const BOTH: Answered = Answered { error: true, limited: true, ..WELL };

    /// Looks every 10 ms; returns when the first fault came, ms, and which.
    fn first(ms: u64, at: impl Fn(u64) -> (ActuationState, Answered)) -> Option<(u64, u32)> {
        let mut watch = AnswerWatch::new(RULES);
        (0..=ms / 10).map(|k| 10 * k).find_map(|t| {
            let (state, answered) = at(t);
            let faults = watch.look(t * MS, state, answered);
            (faults != 0).then_some((t, faults))
        })
    }

    #[test]
    fn an_error_that_lasts_is_a_fault_and_sooner_with_an_estimate_at_its_limit() {
        use ActuationState::Armed;
        assert_eq!(first(9000, |_| (Armed, ERROR)), Some((4000, Reason::TRACKING_ERROR)));
        let both = Reason::TRACKING_ERROR | Reason::PRESSURE_DOUBTED;
        assert_eq!(first(9000, |_| (Armed, BOTH)), Some((1000, both)));
        // An estimate at its limit alone is how a limit works.
        let limited = Answered { limited: true, ..WELL };
        assert_eq!(first(60_000, |_| (Armed, limited)), None);
    }

    #[test]
    fn a_bladder_that_hardly_touches_for_long_is_a_fault() {
        use ActuationState::Armed;
        let loose = Answered { loose: true, ..WELL };
        assert_eq!(first(9000, |_| (Armed, loose)), Some((2000, Reason::CONTACT_LOW)));
        // A cough of half a second every ten.
        assert_eq!(first(60_000, |t| (Armed, if t % 10_000 < 500 { loose } else { WELL })), None);
    }

    #[test]
    fn orders_without_effect_for_long_are_a_fault() {
        use ActuationState::Armed;
        let stuck = Answered { without_effect: true, ..WELL };
        assert_eq!(first(20_000, |_| (Armed, stuck)), Some((2000, Reason::NO_EFFECT)));
        assert_eq!(first(60_000, |t| (Armed, if t % 10_000 < 1900 { stuck } else { WELL })), None);
    }

    #[test]
    fn short_errors_add_up_only_if_they_are_frequent() {
        use ActuationState::Armed;
        // A cough of 1 s in 10 s; then errors for half of the time.
        let part = |on: u64, of: u64| move |t: u64| (Armed, if t % of < on { ERROR } else { WELL });
        assert_eq!(first(120_000, part(1000, 10_000)), None);
        let (at, _) = first(120_000, part(500, 1000)).unwrap();
        assert!((8000..12_000).contains(&at), "{at}");
    }

    #[test]
    fn only_time_in_which_commands_are_followed_counts() {
        use ActuationState::{Armed, Disarmed, Fault, Holding, Venting};
        for state in [Disarmed, Fault, Holding, Venting] {
            assert_eq!(first(60_000, |_| (state, BOTH)), None, "{state:?}");
        }
        // A hold of 1 s in between delays the fault, and a disarming starts anew.
        let with = |between| move |t| (if (3000..4000).contains(&t) { between } else { Armed }, ERROR);
        assert_eq!(first(20_000, with(Holding)).unwrap().0, 5000);
        assert_eq!(first(20_000, with(Disarmed)).unwrap().0, 7990);
    }
}
