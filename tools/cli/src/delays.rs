//! How long the processes of a run waited for a core, by the count of the kernel.

use std::collections::BTreeMap;
use std::fmt;
use std::time::Instant;

use serde::Serialize;

use crate::processes;

/// The counts at one time.
pub struct Delays {
    at: Instant,
    /// By name and number of a process: the time for which its first thread was ready and got no core, s.
    delayed: BTreeMap<(String, u32), f64>,
}

/// The delay of a process over a time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Delay {
    /// The process.
    pub process: String,
    /// The time for which its first thread, which does the work, was ready and got no core, ms.
    pub delayed_ms: f64,
    /// The time over which that was measured, s.
    pub seconds: f64,
}

impl Delays {
    /// The counts of the processes of a supervisor now; empty where the system does not count.
    pub fn now(supervisor: u32) -> Self {
        let states = processes::of_run(supervisor).into_iter();
        let delayed = states.filter_map(|p| Some(((p.name, p.pid), p.delayed_s?))).collect();
        Self { at: Instant::now(), delayed }
    }

    /// The delays since an earlier time, of the processes that were there at both.
    pub fn since(&self, before: &Self) -> Vec<Delay> {
        let seconds = self.at.duration_since(before.at).as_secs_f64();
        let both = self.delayed.iter().filter_map(|(of, now)| Some((of, now - before.delayed.get(of)?)));
        both.map(|((name, _), s)| Delay { process: name.clone(), delayed_ms: s.max(0.0) * 1e3, seconds })
            .collect()
    }
}

impl fmt::Display for Delay {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let share = if self.seconds > 0.0 { 0.1 * self.delayed_ms / self.seconds } else { 0.0 };
        let Self { process, delayed_ms, seconds } = self;
        write!(f, "process {process} waited for a core: {delayed_ms:.1} ms of {seconds:.1} s ({share:.1} %)")
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_delay_is_that_between_two_times_of_a_process_that_goes_on() {
        let at = Instant::now();
        let of = |at, all: &[(&str, u32, f64)]| Delays {
            at,
            delayed: all.iter().map(|(name, pid, s)| (((*name).to_owned(), *pid), *s)).collect(),
        };
        let before = of(at, &[("sink", 7, 1.0), ("ended", 8, 9.0)]);
        // The second was restarted, with counts of its own.
        let now = of(at + Duration::from_secs(2), &[("sink", 7, 1.25), ("ended", 9, 0.1)]);
        let found = now.since(&before);
        assert_eq!(found, [Delay { process: "sink".into(), delayed_ms: 250.0, seconds: 2.0 }]);
        assert_eq!(found[0].to_string(), "process sink waited for a core: 250.0 ms of 2.0 s (12.5 %)");
    }
}
