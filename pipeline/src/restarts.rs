//! What follows on a failure: one policy for panics, deaths and steps beyond their deadline, live and simulated.

use crate::graph::Restart;

/// After this long without a failure, ns, restarts count from zero again.
const CALM: u64 = 10_000_000_000;

/// The restarts of one process.
#[derive(Clone, Debug)]
pub struct Restarts {
    policy: Restart,
    /// Restarts since the last calm.
    in_a_row: u32,
    last: Option<u64>,
}

/// What follows on a failure.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// What failed begins again at this time, ns.
    Again {
        /// Session time, ns.
        at: u64,
    },
    /// The run ends, for this reason.
    GiveUp(String),
}

impl Restarts {
    /// None yet.
    pub fn new(policy: Restart) -> Self {
        Self { policy, in_a_row: 0, last: None }
    }

    /// Answers a failure at `now`, session time in ns: a panic, a death, or a step beyond its deadline.
    pub fn failed(&mut self, now: u64) -> Answer {
        if self.last.replace(now).is_some_and(|last| now.saturating_sub(last) > CALM) {
            self.in_a_row = 0;
        }
        match self.policy {
            Restart::Never => Answer::GiveUp("its restart policy is never".to_string()),
            Restart::OnFault { limit, .. } if self.in_a_row >= limit => {
                Answer::GiveUp(format!("it was restarted {limit} times already"))
            }
            Restart::OnFault { backoff, .. } => {
                let wait = backoff.saturating_mul(1 << self.in_a_row.min(16));
                self.in_a_row += 1;
                Answer::Again { at: now.saturating_add(wait) }
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

    #[test]
    fn the_wait_doubles_and_after_the_limit_the_run_ends() {
        let mut restarts = policy();
        let waits = [100, 200, 400].map(|wait| (restarts.failed(0), Answer::Again { at: wait * MS }));
        assert!(waits.iter().all(|(said, due)| said == due), "{waits:?}");
        assert_eq!(restarts.failed(0), Answer::GiveUp("it was restarted 3 times already".into()));
    }

    #[test]
    fn after_a_calm_they_count_from_zero() {
        let mut restarts = policy();
        for now in [0, MS, 2 * MS] {
            restarts.failed(now);
        }
        let now = 2 * MS + CALM + 1;
        assert_eq!(restarts.failed(now), Answer::Again { at: now + 100 * MS });
        let short = now + CALM;
        assert_eq!(restarts.failed(short), Answer::Again { at: short + 200 * MS });
    }

    #[test]
    fn a_process_that_is_never_restarted_ends_the_run() {
        assert!(matches!(Restarts::new(Restart::Never).failed(7), Answer::GiveUp(_)));
    }
}
