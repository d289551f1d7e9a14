//! Which activation is due: the one rule of the live and the discrete-event schedule.

use stillpoint_samples::Cause;

use crate::intake::Trigger;

/// The ticks of an operator's timer: tick `n` is due at `epoch + n * every`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ticks {
    /// When tick 0 is due, session time in ns.
    pub epoch: u64,
    /// Period, ns; greater than 0.
    pub every: u64,
    /// Number of the next tick.
    pub next: u64,
}

impl Ticks {
    /// The ticks of an operator that begins at `now`: the first is the next one that is due.
    pub fn from(epoch: u64, every: u64, now: u64) -> Self {
        Self { epoch, every, next: now.saturating_sub(epoch).div_ceil(every) }
    }

    /// When a tick is due, session time in ns.
    fn time_of(&self, tick: u64) -> u64 {
        self.epoch.saturating_add(tick.saturating_mul(self.every))
    }

    /// When the next tick is due, session time in ns.
    pub fn due(&self) -> u64 {
        self.time_of(self.next)
    }

    /// The tick that an activation at `now` takes, where one is due: the newest. Ticks that passed while the operator
    /// was busy are skipped, which shows in the number.
    fn newest(&self, now: u64) -> Option<u64> {
        (self.due() <= now).then(|| ((now - self.epoch) / self.every).max(self.next))
    }
}

/// The activation that is due.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Decision {
    /// What causes it.
    pub cause: Cause,
    /// The input that causes it, or the first of the set; 0 where the timer does.
    pub port: usize,
    /// When it was due, session time in ns.
    pub nominal: u64,
    /// Number of the tick; 0 where an input causes it.
    pub tick: u64,
}

/// Decides which activation an operator does at `now`: what came before a tick, or with it, is seen before the tick.
/// `None`: nothing is due.
pub fn decide(now: u64, input: Option<Trigger>, ticks: Option<&Ticks>) -> Option<Decision> {
    let tick = ticks.and_then(|ticks| Some((ticks, ticks.newest(now)?)));
    match (input, tick) {
        (Some(trigger), tick) if tick.is_none_or(|(ticks, _)| trigger.since <= ticks.due()) => {
            Some(Decision { cause: trigger.cause, port: trigger.port, nominal: now, tick: 0 })
        }
        (_, Some((ticks, tick))) => {
            Some(Decision { cause: Cause::Timer, port: 0, nominal: ticks.time_of(tick), tick })
        }
        (_, None) => None,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const EPOCH: u64 = 1_000;

    fn ticks() -> impl Strategy<Value = Ticks> {
        (1..50_u64, 0..20_u64).prop_map(|(every, next)| Ticks { epoch: EPOCH, every, next })
    }

    fn trigger() -> impl Strategy<Value = Option<Trigger>> {
        prop::option::of((0..2_000_u64, 0..3_usize).prop_map(|(since, port)| Trigger {
            since,
            cause: Cause::Input,
            port,
        }))
    }

    proptest! {
        #[test]
        fn an_input_goes_before_a_tick_that_was_due_no_earlier(
            now in EPOCH..3_000, input in trigger(), ticks in ticks()
        ) {
            let input = input.filter(|t| t.since <= now);
            let is_time = ticks.due() <= now;
            let decision = decide(now, input, Some(&ticks));
            match input {
                Some(t) if !is_time || t.since <= ticks.due() => {
                    let expected = Decision { cause: t.cause, port: t.port, nominal: now, tick: 0 };
                    prop_assert_eq!(decision, Some(expected));
                }
                _ if is_time => prop_assert_eq!(decision.map(|d| d.cause), Some(Cause::Timer)),
                _ => prop_assert_eq!(decision, None),
            }
        }

        #[test]
        fn a_timer_takes_the_newest_tick_that_is_due(now in EPOCH..3_000, ticks in ticks()) {
            // The ticks one by one.
            let newest = (ticks.next..).take_while(|n| EPOCH + n * ticks.every <= now).last();
            let decision = decide(now, None, Some(&ticks));
            prop_assert_eq!(decision.map(|d| d.tick), newest);
            prop_assert_eq!(decision.map(|d| d.nominal), newest.map(|n| EPOCH + n * ticks.every));
        }

        #[test]
        fn ticks_rise_and_none_is_taken_before_its_time(
            every in 1..50_u64, begun in 900..1_100_u64, steps in prop::collection::vec(0..200_u64, 1..30)
        ) {
            let mut ticks = Ticks::from(EPOCH, every, begun);
            prop_assert!(ticks.due() >= begun.min(EPOCH.max(begun)));
            let (mut now, mut last) = (begun, None);
            for step in steps {
                now += step;
                if let Some(decision) = decide(now, None, Some(&ticks)) {
                    prop_assert!(decision.nominal <= now && now - decision.nominal < every);
                    prop_assert!(last.is_none_or(|last| last < decision.tick));
                    last = Some(decision.tick);
                    ticks.next = decision.tick + 1;
                    prop_assert_eq!(decide(now, None, Some(&ticks)), None);
                }
            }
        }

        #[test]
        fn the_end_of_time_is_no_overflow(
            epoch in any::<u64>(), every in 1..u64::MAX, next in any::<u64>(), now in any::<u64>()
        ) {
            let ticks = Ticks { epoch: epoch.min(now), every, next };
            if let Some(decision) = decide(now, None, Some(&ticks)) {
                prop_assert!(decision.nominal <= now);
            }
        }
    }
}
