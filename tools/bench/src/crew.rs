//! Independent runs in several threads. The results are in the order of the runs.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use stillpoint::Failure;

/// Number of threads of a measurement. The default is the number of cores that this process may use.
pub fn threads(asked: Option<usize>) -> usize {
    asked.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, Into::into))
}

/// Executes `work` for each of `jobs` in this number of threads, and shows the progress on standard error. The results
/// are in the order of `jobs`.
pub fn each<J: Sync, R: Send>(
    jobs: &[J],
    threads: usize,
    work: impl Fn(&J) -> Result<R, Failure> + Sync,
) -> Result<Vec<R>, Failure> {
    let next = AtomicUsize::new(0);
    let results: Mutex<Vec<Option<Result<R, Failure>>>> = Mutex::new(jobs.iter().map(|_| None).collect());
    std::thread::scope(|scope| {
        for _ in 0..threads.min(jobs.len()) {
            scope.spawn(|| {
                loop {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    let Some(job) = jobs.get(number) else { break };
                    let result = work(job);
                    let Ok(mut results) = results.lock() else { break };
                    results[number] = Some(result);
                    let done = results.iter().flatten().count();
                    err!("\r{done} of {} runs", jobs.len());
                    if done == jobs.len() {
                        errln!();
                    }
                }
            });
        }
    });
    let results = results.into_inner().map_err(Failure::failed)?;
    results.into_iter().map(|r| r.unwrap_or_else(|| Err(Failure::failed("a run was not made")))).collect()
}
