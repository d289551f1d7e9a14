//! The signals that end a command in order: Ctrl-C, SIGTERM, and SIGHUP as SIGTERM.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

use crate::exit::Failure;

/// A signal after one that nobody took for so long ends the process. Some send the same one twice at once, as `timeout`.
const UNHEARD: Duration = Duration::from_secs(1);

/// A flag that the signals set.
pub fn stop_flag() -> Result<Arc<AtomicBool>, Failure> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in those_that_stop() {
        signal_hook::flag::register(signal, stop.clone()).map_err(Failure::failed)?;
    }
    Ok(stop)
}

/// The same for work in this process, which may never come to look at the flag: a further signal ends the process then.
pub fn stop_flag_of_this_process() -> Result<Arc<AtomicBool>, Failure> {
    let stop = Arc::new(AtomicBool::new(false));
    let mut signals = Signals::new(those_that_stop()).map_err(Failure::failed)?;
    let flag = stop.clone();
    std::thread::spawn(move || {
        let mut set: Option<Instant> = None;
        for signal in signals.forever() {
            let unheard = flag.swap(true, Ordering::Relaxed);
            if unheard && set.is_some_and(|at| at.elapsed() > UNHEARD) {
                let _ = signal_hook::low_level::emulate_default_handler(signal);
            }
            if !unheard {
                set = Some(Instant::now());
            }
        }
    });
    Ok(stop)
}

/// Who starts a command with `nohup` wants it to go on.
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
    fn a_hang_up_that_is_ignored_is_left_so() {
        assert!(is_ignored("Name:\tsp\nSigIgn:\t0000000000001001\n", SIGHUP));
        assert!(!is_ignored("Name:\tsp\nSigIgn:\t0000000000001000\n", SIGHUP));
        assert!(!is_ignored("", SIGHUP));
    }
}
