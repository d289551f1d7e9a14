//! The signals that end a command in order: Ctrl-C, SIGTERM, and SIGHUP as SIGTERM.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

use stillpoint_pipeline::limits::start_thread;

use crate::exit::Failure;

/// Signals come in pairs: when a terminal closes, both shell and kernel send SIGHUP, and `timeout` signals the process and
/// its group. A signal within this time after one that counted is a repeat.
const REPEAT: Duration = Duration::from_secs(1);

/// A flag that each signal sets, except a repeat.
pub fn stop_flag() -> Result<Arc<AtomicBool>, Failure> {
    received(|_| ())
}

/// The same for work in this process. The work may never look at the flag, so a further signal while the flag is still set
/// ends the process.
pub fn stop_flag_of_this_process() -> Result<Arc<AtomicBool>, Failure> {
    received(|signal| {
        let _ = signal_hook::low_level::emulate_default_handler(signal);
    })
}

/// A flag that the signals set; `unheard` is called for a signal that finds the flag still set.
fn received(unheard: fn(i32)) -> Result<Arc<AtomicBool>, Failure> {
    let stop = Arc::new(AtomicBool::new(false));
    let mut signals = Signals::new(those_that_stop()).map_err(Failure::failed)?;
    let flag = stop.clone();
    start_thread(move || {
        let mut counted = None;
        for signal in signals.forever() {
            if counts(&mut counted, Instant::now()) && flag.swap(true, Ordering::Relaxed) {
                unheard(signal);
            }
        }
    })
    .map_err(|e| Failure::failed(format!("the thread that waits for signals cannot be started: {e}")))?;
    Ok(stop)
}

/// Whether a signal is not a repeat of the signal that `counted` last.
fn counts(counted: &mut Option<Instant>, now: Instant) -> bool {
    let new = counted.is_none_or(|at| now.duration_since(at) > REPEAT);
    if new {
        *counted = Some(now);
    }
    new
}

/// The signals that stop the command. SIGHUP is left out if it is ignored, as under `nohup`.
fn those_that_stop() -> Vec<i32> {
    let mut signals = vec![SIGINT, SIGTERM];
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    if !is_ignored(&status, SIGHUP) {
        signals.push(SIGHUP);
    }
    signals
}

/// Whether a process of this `/proc` status ignores a signal.
fn is_ignored(status: &str, signal: i32) -> bool {
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    mask.is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_signal_soon_after_another_is_its_repeat() {
        let (mut counted, begun) = (None, Instant::now());
        let at = [0.0, 0.000_27, 0.9, 1.1, 1.2, 2.0, 2.2].map(|s| begun + Duration::from_secs_f64(s));
        let of = at.map(|at| counts(&mut counted, at));
        assert_eq!(of, [true, false, false, true, false, false, true]);
    }

    #[test]
    fn a_hang_up_that_is_ignored_is_left_so() {
        assert!(is_ignored("Name:\tsp\nSigIgn:\t0000000000001001\n", SIGHUP));
        assert!(!is_ignored("Name:\tsp\nSigIgn:\t0000000000001000\n", SIGHUP));
        assert!(!is_ignored("", SIGHUP));
    }
}
