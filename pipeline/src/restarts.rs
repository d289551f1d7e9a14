//! The restart policy: one for panics, exited processes and steps beyond their deadline, live and simulated.

use crate::graph::Restart;

/// After this long without a failure from a restart on, ns, restarts count from zero again: a wait is no calm.
const CALM: u64 = 10_000_000_000;

/// The restarts of one process.
#[derive(Clone, Debug)]
pub struct Restarts {
    policy: Restart,
    /// Restarts since the last calm.
    in_a_row: u32,
    /// When what failed last began again, session time in ns.
    began: Option<u64>,
    /// Longest wait, ns.
    longest: u64,
}

/// What follows on a failure.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// What failed begins again at this time, ns.
    RestartAt {
        /// Session time, ns.
        at: u64,
    },
    /// The run ends, for this reason.
    GiveUp(String),
}

impl Restarts {
    /// None yet.
    pub fn new(policy: Restart) -> Self {
        Self { policy, in_a_row: 0, began: None, longest: u64::MAX }
    }

    /// The same with waits of at most this many ns.
    pub fn waiting_at_most(self, longest: u64) -> Self {
        Self { longest, ..self }
    }

    /// Answers a failure at `now`, session time in ns: a panic, a death, or a step beyond its deadline.
    pub fn failed(&mut self, now: u64) -> Answer {
        if self.began.is_some_and(|began| now.saturating_sub(began) > CALM) {
            self.in_a_row = 0;
        }
        match self.policy {
            Restart::Never => Answer::GiveUp("its restart policy is never".to_string()),
            Restart::OnFault { limit, .. } if self.in_a_row >= limit => {
                Answer::GiveUp(format!("it was restarted {limit} times already"))
            }
            Restart::OnFault { backoff, .. } => {
                let wait = backoff.saturating_mul(1 << self.in_a_row.min(16)).min(self.longest);
                self.in_a_row = self.in_a_row.saturating_add(1);
                let at = now.saturating_add(wait);
                self.began = Some(at);
                Answer::RestartAt { at }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn policy() -> Restarts {
        Restarts::new(Restart::OnFault { limit: 3, backoff: 100 * MS })
    }

    /// Fails again and again, each time so long after it began again. Gives the waits, and the last answer.
    fn fail_on(mut restarts: Restarts, after: u64, most: usize) -> (Vec<u64>, Answer) {
        let (mut now, mut waits) = (0, Vec::new());
        loop {
            match restarts.failed(now) {
                Answer::RestartAt { at } if waits.len() < most => {
                    waits.push(at - now);
                    now = at + after;
                }
                last => return (waits, last),
            }
        }
    }

    #[test]
    fn the_wait_doubles_and_after_the_limit_the_run_ends() {
        let over = Answer::GiveUp("it was restarted 3 times already".into());
        assert_eq!(fail_on(policy(), MS, 9), (vec![100 * MS, 200 * MS, 400 * MS], over.clone()));
        assert_eq!(fail_on(policy(), CALM, 9).1, over);
    }

    #[test]
    fn a_wait_longer_than_the_calm_is_no_calm() {
        let slow = Restarts::new(Restart::OnFault { limit: 3, backoff: CALM });
        let over = Answer::GiveUp("it was restarted 3 times already".into());
        assert_eq!(fail_on(slow, 0, 9), (vec![CALM, 2 * CALM, 4 * CALM], over));
    }

    #[test]
    fn after_a_calm_they_count_from_zero() {
        let (waits, last) = fail_on(policy(), CALM + 1, 20);
        assert_eq!(waits, [100 * MS; 20]);
        assert!(matches!(last, Answer::RestartAt { .. }));
    }

    #[test]
    fn no_wait_is_longer_than_the_longest() {
        let (waits, _) = fail_on(policy().waiting_at_most(250 * MS), MS, 9);
        assert_eq!(waits, [100 * MS, 200 * MS, 250 * MS]);
    }

    #[test]
    fn a_process_that_is_never_restarted_ends_the_run() {
        assert!(matches!(Restarts::new(Restart::Never).failed(7), Answer::GiveUp(_)));
    }
}
