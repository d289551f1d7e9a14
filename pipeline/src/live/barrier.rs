//! The start barrier, live and in lock-step: every process makes its ports, then every process connects to the ports of
//! the others, and only then the first sample is sent.

use std::time::{Duration, Instant};

use super::children::{Child, ReportedFault};
use super::control::ToWorker;

/// How long a process may take to make its ports.
pub const PATIENCE: Duration = Duration::from_secs(60);
/// How soon a signal is noticed.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// Why a run does not begin.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BarrierError {
    /// The run was stopped while it was starting.
    #[error("stopped while it was starting: no activation was done")]
    Stopped,
    /// A process gave the reason for which it cannot begin.
    #[error("{0}")]
    Refused(String),
    /// A process ended before its ports were made, without a reason.
    #[error("process {0} ended before its ports were made: start the run again")]
    Ended(String),
    /// A process did not make its ports in time.
    #[error("process {0} did not make its ports: start the run again")]
    NotMade(String),
    /// A process did not connect in time.
    #[error("process {0} did not connect to the others: start the run again")]
    NotConnected(String),
}

/// Waits until every process has made its ports, or `is_stopped`.
pub fn wait_until_made<'c>(
    children: impl Iterator<Item = &'c mut Child>,
    reported: &mut Vec<ReportedFault>,
    is_stopped: impl Fn() -> bool,
) -> Result<(), BarrierError> {
    for child in children {
        let begun = Instant::now();
        while !child.made && !child.is_gone() && begun.elapsed() < PATIENCE && !is_stopped() {
            child.wait(POLL_INTERVAL, reported, |c| c.made);
        }
        if is_stopped() {
            return Err(BarrierError::Stopped);
        }
        if !child.made {
            let message = child.fatal_reason.take().or_else(|| reported.first().map(|t| t.reason.clone()));
            return Err(match message {
                Some(reason) => BarrierError::Refused(reason),
                None if child.is_gone() => BarrierError::Ended(child.name.clone()),
                None => BarrierError::NotMade(child.name.clone()),
            });
        }
    }
    Ok(())
}

/// Has every worker connect to all publishers that are there, by the order of this number, and waits for at most
/// `patience` in all. Names the first worker that has not connected.
pub fn connect(
    workers: &mut [&mut Child],
    number: u64,
    patience: Duration,
    reported: &mut Vec<ReportedFault>,
) -> Result<(), BarrierError> {
    let begun = Instant::now();
    for worker in workers.iter_mut() {
        worker.order_connect(number, ToWorker::Connect);
    }
    let mut late = None;
    for worker in workers.iter_mut() {
        let left = patience.saturating_sub(begun.elapsed());
        if !worker.wait(left, reported, |c| c.connected >= number) {
            late.get_or_insert_with(|| worker.name.clone());
        }
    }
    late.map_or(Ok(()), |name| Err(BarrierError::NotConnected(name)))
}
