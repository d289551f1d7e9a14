//! Independent jobs in several threads, with their progress on standard error.

use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicUsize, Ordering};

use stillpoint_plan::threads::on_threads;

use crate::exit::Failure;

/// Number of threads of a measurement. The default is the number of cores that this process may use.
#[must_use]
pub fn threads(requested: Option<usize>) -> usize {
    requested.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, Into::into))
}

/// Executes `work` for each of `jobs` in at most this number of threads. The results are in the order of `jobs`.
///
/// # Errors
/// That of the first job whose work failed; all other jobs are executed.
pub fn each<J: Sync, R: Send>(
    jobs: &[J],
    threads: usize,
    work: impl Fn(&J) -> Result<R, Failure> + Sync,
) -> Result<Vec<R>, Failure> {
    let done = AtomicUsize::new(0);
    on_threads(jobs, NonZeroUsize::new(threads).unwrap_or(NonZeroUsize::MIN), |job| {
        let result = work(job);
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        err!("\r{done} of {} runs", jobs.len());
        if done == jobs.len() {
            errln!();
        }
        result
    })
}
