//! The session's clock: realtime at the session's start plus monotonic time since, so that it never jumps.
//!
//! Only executors and sources read it. Operators see the time of their activation.

use rustix::time::{ClockId, clock_gettime};
use serde::{Deserialize, Serialize};

/// The clock of a session, the same in every process of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SessionClock {
    realtime_start: u64,
    monotonic_start: u64,
}

impl SessionClock {
    /// A clock that starts now.
    pub fn start() -> Self {
        Self { realtime_start: read(ClockId::Realtime), monotonic_start: read(ClockId::Monotonic) }
    }

    /// A clock for sessions whose time is simulated: it starts at 0.
    pub fn zero() -> Self {
        Self { realtime_start: 0, monotonic_start: 0 }
    }

    /// Session time, ns since the epoch.
    pub fn now(&self) -> u64 {
        self.realtime_start + read(ClockId::Monotonic).saturating_sub(self.monotonic_start)
    }

    /// How far the system's clock was set ahead since the session started, ns; below 0: back. Session time does not follow it.
    pub fn set_ahead(&self) -> i64 {
        // Both are times of this century.
        read(ClockId::Realtime) as i64 - self.now() as i64
    }

    /// Session time at which the session started.
    pub fn started(&self) -> u64 {
        self.realtime_start
    }
}

/// The system's realtime, ns since the epoch: for people, never for operators.
pub fn realtime() -> u64 {
    read(ClockId::Realtime)
}

/// CPU time of this process, ns.
pub fn cpu_time() -> u64 {
    read(ClockId::ProcessCPUTime)
}

fn read(clock: ClockId) -> u64 {
    let t = clock_gettime(clock);
    u64::try_from(t.tv_sec).unwrap_or(0) * 1_000_000_000 + u64::try_from(t.tv_nsec).unwrap_or(0)
}

/// Whether this thread rounds to nearest and keeps subnormal numbers, as every recorded result assumes.
pub fn float_state_is_standard() -> bool {
    use std::hint::black_box;
    let subnormal = black_box(f64::MIN_POSITIVE) / black_box(2.0);
    let half_ulp = black_box(f64::EPSILON) / black_box(2.0);
    let up = black_box(1.0) + half_ulp * black_box(1.5);
    subnormal != 0.0 && black_box(1.0) + half_ulp == 1.0 && up == 1.0 + f64::EPSILON
}
