//! The watch over deadlines.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use super::control::FromWorker;
use super::pipe::send_message;
use crate::graph::Graph;
use crate::limits::{StartError, start_thread};

/// Ends the process when a step takes longer than its operator's deadline.
pub struct Watch {
    /// Number of the operator plus one, in the high half, and microseconds since the watch began, in the low half; 0
    /// between steps.
    now: Arc<AtomicU64>,
    started: std::time::Instant,
}

impl Watch {
    /// Begins to watch, if any of the operators has a deadline.
    pub fn start(graph: &Arc<Graph>, operators: &[usize]) -> Result<Option<Self>, StartError> {
        let deadlines = operators.iter().filter_map(|o| graph.operators[*o].deadline);
        let Some(shortest) = deadlines.min() else { return Ok(None) };
        let now = Arc::new(AtomicU64::new(0));
        let started = std::time::Instant::now();
        let (word, graph) = (now.clone(), graph.clone());
        let period = std::time::Duration::from_nanos((shortest / 4).clamp(1_000_000, 50_000_000));
        start_thread(move || {
            loop {
                std::thread::sleep(period);
                let value = word.load(Ordering::Relaxed);
                let Some(operator) = (value >> 40).checked_sub(1) else { continue };
                let node = &graph.operators[operator as usize];
                let since = value & 0xff_ffff_ffff;
                let elapsed = (started.elapsed().as_micros() as u64).saturating_sub(since) * 1000;
                if node.deadline.is_some_and(|deadline| elapsed > deadline) {
                    let fault = FromWorker::Fault {
                        operator: node.name.clone(),
                        incarnation: 0,
                        reason: format!(
                            "a step has taken {} us, longer than its deadline of {} us",
                            elapsed / 1000,
                            node.deadline.unwrap_or(0) / 1000
                        ),
                        fatal: true,
                    };
                    let _ = send_message(&fault);
                    rustix::process::kill_process(rustix::process::getpid(), rustix::process::Signal::KILL)
                        .ok();
                }
            }
        })?;
        Ok(Some(Self { now, started }))
    }

    /// A step of this operator begins.
    pub fn enter(&self, operator: usize) {
        let since = (self.started.elapsed().as_micros() as u64) & 0xff_ffff_ffff;
        self.now.store(((operator as u64 + 1) << 40) | since, Ordering::Relaxed);
    }

    /// The step has ended.
    pub fn leave(&self) {
        self.now.store(0, Ordering::Relaxed);
    }
}
