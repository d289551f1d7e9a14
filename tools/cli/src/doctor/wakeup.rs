//! How late a thread wakes, and how far the clocks drift apart.

use std::time::Duration;

use rustix::time::{ClockId, clock_gettime};

use super::finding::Finding;

/// Period of the test.
const EVERY: u64 = 1_000_000;
/// The part of the shortest period of a pipeline that a wake-up may be late.
const LATE: f64 = 0.25;
/// Period that is taken where a pipeline has no timer, ns.
const USUAL: u64 = 10_000_000;
/// Drift of the clocks that is too much, parts per million.
const DRIFT: f64 = 500.0;

/// What the test measured.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measured {
    /// How late each wake-up was, ns, in rising order.
    pub late: Vec<u64>,
    /// Drift of the session's clock against the clock that nothing corrects, parts per million.
    pub drift_ppm: f64,
    /// How far realtime jumped against the session's clock during the test, ns.
    pub jumped: i64,
}

fn now(clock: ClockId) -> i64 {
    let t = clock_gettime(clock);
    t.tv_sec.saturating_mul(1_000_000_000).saturating_add(t.tv_nsec)
}

/// Sleeps from tick to tick for this time, and measures how late each wake-up is.
pub fn measure(time: Duration) -> Measured {
    let clocks = || [ClockId::Monotonic, ClockId::MonotonicRaw, ClockId::Realtime].map(now);
    let begun = clocks();
    let mut late = Vec::new();
    let mut due = begun[0];
    while (now(ClockId::Monotonic) - begun[0]) < time.as_nanos() as i64 {
        due += EVERY as i64;
        let left = due - now(ClockId::Monotonic);
        if left <= 0 {
            // Ticks that passed during a late wake-up are its lateness, not wake-ups of their own.
            due = now(ClockId::Monotonic);
            continue;
        }
        std::thread::sleep(Duration::from_nanos(left as u64));
        late.push((now(ClockId::Monotonic) - due).max(0) as u64);
    }
    late.sort_unstable();
    let passed: Vec<i64> = clocks().iter().zip(begun).map(|(end, begun)| end - begun).collect();
    let drift_ppm = (passed[0] - passed[1]) as f64 / passed[1].max(1) as f64 * 1e6;
    Measured { late, drift_ppm, jumped: passed[2] - passed[0] }
}

impl Measured {
    fn quantile(&self, share: f64) -> Option<u64> {
        let rank = (share * self.late.len() as f64).ceil() as usize;
        self.late.get(rank.clamp(1, self.late.len().max(1)) - 1).copied()
    }

    /// The judgement, for a pipeline whose shortest timer has this period, ns.
    pub fn findings(&self, shortest: Option<u64>) -> Vec<Finding> {
        let us = |ns: u64| format!("{:.0} us", ns as f64 * 1e-3);
        let period = shortest.unwrap_or(USUAL);
        let allowed = (period as f64 * LATE) as u64;
        let setting = "wake-up of a thread";
        let requested = format!(
            "99 % at most {} late, a quarter of a period of {} ms",
            us(allowed),
            period as f64 * 1e-6
        );
        let wakes = match (self.quantile(0.5), self.quantile(0.99), self.late.last()) {
            (Some(p50), Some(p99), Some(worst)) => {
                let found =
                    format!("p50 {}, p99 {}, worst {} of {}", us(p50), us(p99), us(*worst), self.late.len());
                if p99 <= allowed {
                    Finding::good(setting, requested, found)
                } else {
                    let mend = "end other work; `core:` and `priority: fifo 50` for the process; a kernel with PREEMPT_RT";
                    Finding::bad(setting, requested, found, mend).lasting()
                }
            }
            _ => Finding::unknown(setting, requested, "the test was too short"),
        };
        let (setting, requested) =
            ("drift of the clock", format!("at most {DRIFT} ppm against the uncorrected clock"));
        let found = format!("{:.1} ppm", self.drift_ppm);
        let drift = if self.drift_ppm.abs() <= DRIFT {
            Finding::good(setting, requested, found)
        } else {
            Finding::bad(setting, requested, found, "look at the time service (`chronyc tracking`)").hint()
        };
        let (setting, requested) = ("jumps of realtime", "none during the test");
        let jump = if self.jumped.unsigned_abs() < 100_000_000 {
            Finding::good(setting, requested, "none")
        } else {
            let found = format!("{:.3} s", self.jumped as f64 * 1e-9);
            Finding::bad(setting, requested, found, "look at the time service (`chronyc tracking`)").hint()
        };
        vec![wakes, drift, jump]
    }
}

#[cfg(test)]
mod tests {
    use super::super::finding::Verdict;
    use super::*;

    #[test]
    fn late_wake_ups_are_bad_for_a_short_period_and_good_for_a_long_one() {
        let late = (1..=100).map(|i| i * 20_000).collect();
        let measured = Measured { late, drift_ppm: 3.0, jumped: 0 };
        let verdict = |shortest| measured.findings(Some(shortest))[0].verdict;
        // 99 % are at most 1.98 ms late.
        assert_eq!(verdict(7_900_000), Verdict::Bad);
        assert_eq!(verdict(8_000_000), Verdict::Good);
        let jumped = Measured { drift_ppm: 900.0, jumped: -2_000_000_000, ..measured };
        let found = jumped.findings(None);
        assert_eq!((found[1].verdict, found[2].found.as_str()), (Verdict::Unknown, "-2.000 s"));
    }

    #[test]
    fn a_test_measures_wake_ups_that_are_not_early() {
        let measured = measure(Duration::from_millis(50));
        assert!(!measured.late.is_empty() && measured.late.is_sorted());
        assert_eq!(measured.findings(None).len(), 3);
    }
}
