//! The processes of a run, what they take, and random numbers to choose one of them to kill.

use rustix::process::Pid;

/// Names and numbers of the running processes that a supervisor started.
pub fn children(supervisor: u32) -> Vec<(String, Pid)> {
    let path = format!("/proc/{supervisor}/task");
    let Ok(tasks) = std::fs::read_dir(path) else { return Vec::new() };
    let lists = tasks.flatten().filter_map(|t| std::fs::read_to_string(t.path().join("children")).ok());
    let numbers =
        lists.flat_map(|l| l.split_whitespace().filter_map(|n| n.parse().ok()).collect::<Vec<i32>>());
    numbers
        .filter_map(|number| {
            let line = std::fs::read(format!("/proc/{number}/cmdline")).ok()?;
            let name = String::from_utf8_lossy(line.split(|b| *b == 0).nth(2)?).into_owned();
            Some((name, Pid::from_raw(number)?))
        })
        .collect()
}

/// CPU time of the threads of a process, ns; 0 if the system does not state it.
pub fn cpu(process: Pid) -> u64 {
    scheduled(process, 0)
}

/// Time that the threads of a process have waited for a core, ns; 0 if the system does not state it.
pub fn waited(process: Pid) -> u64 {
    scheduled(process, 1)
}

/// Memory of a process in RAM, bytes: a page that several processes have counts in equal parts for each; 0 if the system
/// does not state it.
pub fn memory(process: Pid) -> u64 {
    let text = std::fs::read_to_string(format!("/proc/{}/smaps_rollup", process.as_raw_nonzero()));
    let text = text.unwrap_or_default();
    let line = text.lines().find_map(|line| line.strip_prefix("Pss:"));
    line.and_then(|line| line.split_whitespace().next()?.parse::<u64>().ok()).unwrap_or(0) * 1024
}

/// The sum of a field of `schedstat` over the threads of a process.
fn scheduled(process: Pid, field: usize) -> u64 {
    let tasks = std::fs::read_dir(format!("/proc/{}/task", process.as_raw_nonzero()));
    let lines = tasks.into_iter().flatten().flatten();
    let lines = lines.filter_map(|t| std::fs::read_to_string(t.path().join("schedstat")).ok());
    lines.filter_map(|line| line.split_whitespace().nth(field)?.parse::<u64>().ok()).sum()
}

/// Pseudo-random numbers that differ from run to run.
pub struct Chance(u64);

impl Chance {
    /// Seeds the numbers with the time of day.
    pub fn new() -> Self {
        Self(stillpoint_pipeline::clock::realtime())
    }

    /// Draws a whole number from 0 to below `below`.
    pub fn draw(&mut self, below: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % below.max(1)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::Ordering;

    use super::*;

    #[test]
    fn who_has_to_share_its_core_is_seen_to_wait() {
        let own = rustix::process::getpid();
        let before = waited(own);
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        // Asked while all still run: a thread that ended takes the time that it waited with it.
        let seen = std::sync::atomic::AtomicBool::new(false);
        let busy = || {
            let begun = std::time::Instant::now();
            while !seen.load(Ordering::Relaxed) && begun.elapsed().as_secs() < 60 {
                if waited(own) > before {
                    seen.store(true, Ordering::Relaxed);
                }
            }
        };
        std::thread::scope(|scope| (0..4 * cores).for_each(|_| drop(scope.spawn(busy))));
        assert!(seen.into_inner());
    }
}
