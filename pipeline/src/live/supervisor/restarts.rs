//! The end of a child process: its restart, or the end of the run.

use std::os::unix::process::ExitStatusExt;
use std::process::ExitStatus;
use std::time::Duration;

use super::{Supervisor, Worker};
use crate::graph::{ProcessNode, Restart};
use crate::live::children::{Child, ChildError, ReportedFault};
use crate::live::control::ToWorker;
use crate::live::log::Level;
use crate::live::reservation::is_full;
use crate::restarts::{Answer, Restarts};

/// Wait before the recorder is started again, ns; it doubles each time, up to [`RECORDER_LONGEST`].
const RECORDER_BACKOFF: u64 = 10_000_000;
/// Longest wait before the recorder is started again, ns.
const RECORDER_LONGEST: u64 = 5_000_000_000;

/// Longest wait before the bridge is started again, ns: the other hosts may be at fault.
const BRIDGE_LONGEST: u64 = 2_000_000_000;

/// Interval at which the ports of killed programs that had attached are given back, ns.
const VISITORS: u64 = 2_000_000_000;

/// A process that is gone, and whose node is not cleaned yet.
pub(super) struct Dead {
    /// Its number, if it was a worker.
    process: Option<usize>,
    pid: u32,
    /// Number of the order to connect that went before it began.
    began: u64,
}

/// The restarts of a recorder: there is no limit.
pub(super) fn of_recorder() -> Restarts {
    let policy = Restart::OnFault { limit: u32::MAX, backoff: RECORDER_BACKOFF };
    Restarts::new(policy).waiting_at_most(RECORDER_LONGEST)
}

/// The restarts of a process of operators, or of the bridge, which has none.
pub(super) fn of_process(process: &ProcessNode) -> Restarts {
    let restarts = Restarts::new(process.restart);
    if process.operators.is_empty() { restarts.waiting_at_most(BRIDGE_LONGEST) } else { restarts }
}

/// The text for the end of a process. A write beyond the end of shared memory is a SIGBUS.
fn how(status: Option<ExitStatus>, is_full: impl Fn() -> bool) -> String {
    match status {
        None => "unknown".to_string(),
        Some(status) if status.signal() == Some(signal_hook::consts::SIGBUS) && is_full() => {
            format!("{status}: /dev/shm is full; make room in it, or make it larger")
        }
        Some(status) => status.to_string(),
    }
}

impl Supervisor {
    /// Reaps exited children, and restarts those that are due. Gives the reason for which the run cannot go on, if there is
    /// one.
    pub(super) fn attend_children(&mut self, now: u64) -> Result<Option<String>, ChildError> {
        for index in 0..self.workers.len() {
            if let Some(reason) = self.answer_panics(index, now) {
                return Ok(Some(reason));
            }
            if self.workers[index].child.as_ref().is_some_and(Child::is_gone)
                && let Some(reason) = self.reap_worker(index, now)
            {
                return Ok(Some(reason));
            }
        }
        self.check_recorder();
        if self.recorder.as_ref().is_some_and(Child::is_gone) {
            self.reap_recorder(now);
        }
        self.clean_dead_nodes_that_are_read();
        if now >= self.visitors_due {
            self.visitors_due = now + VISITORS;
            self.domain.clean_dead_visitors();
        }
        if self.recorder_due.is_some_and(|due| due <= now) {
            self.recorder_due = None;
            self.start_recorder()?;
        }
        for index in 0..self.workers.len() {
            if self.workers[index].due.is_some_and(|due| due <= now)
                && !self.is_uncleaned(self.workers[index].process)
            {
                self.restart(index)?;
            }
        }
        self.start_ready_processes();
        Ok(None)
    }

    /// Orders operators that panicked to begin again at a time. Gives the reason for which the run ends, if their restart
    /// policy ends it.
    fn answer_panics(&mut self, index: usize, now: u64) -> Option<String> {
        let Worker { child: Some(child), restarts, .. } = &mut self.workers[index] else { return None };
        for (name, message) in std::mem::take(&mut child.panicked) {
            match (restarts.failed(now), self.graph.operator(&name)) {
                (Answer::GiveUp(why), _) => return Some(format!("operator {name}: {message}; {why}")),
                (Answer::RestartAt { at }, Some(operator)) => {
                    child.send_message(&ToWorker::Renew { operator, at })
                }
                (Answer::RestartAt { .. }, None) => {}
            }
        }
        None
    }

    /// Reaps a child that has exited, reports how it ended, and gives that text.
    pub(super) fn reap(&mut self, mut child: Child) -> String {
        let (name, message) = (child.name.clone(), child.fatal_reason.take());
        let status = child.reap(Duration::from_secs(1));
        let reason = format!("process {name} ended: {}", how(status, is_full));
        self.reported.push(ReportedFault {
            operator: name,
            incarnation: 0,
            reason: reason.clone(),
            fatal: true,
        });
        message.map_or_else(|| reason.clone(), |message| format!("{reason} ({message})"))
    }

    /// Reaps a process that has exited, and has all others connect to the samples that it left. Its node is cleaned once the
    /// recorder has connected to it, by the order that went before the process `began`. Gives the text for its end.
    fn reap_and_reconnect(&mut self, child: Child, process: Option<usize>, began: u64) -> String {
        self.dead.push(Dead { process, pid: child.pid(), began });
        let reason = self.reap(child);
        self.connect_all();
        reason
    }

    /// Cleans the nodes of exited processes, except those to which the recorder has not connected yet.
    fn clean_dead_nodes_that_are_read(&mut self) {
        let (retained, known): (Vec<_>, Vec<_>) =
            std::mem::take(&mut self.dead).into_iter().partition(|dead| !self.is_recorder_at(dead.began));
        if !known.is_empty() {
            self.read_journals();
            self.domain.clean_dead_nodes(&retained.iter().map(|dead| dead.pid).collect::<Vec<_>>());
        }
        self.dead = retained;
    }

    /// Whether a process died and its node is not cleaned yet.
    fn is_uncleaned(&self, process: usize) -> bool {
        self.dead.iter().any(|dead| dead.process == Some(process))
    }

    /// A worker is gone: its restart is planned, if its policy allows one.
    fn reap_worker(&mut self, index: usize, now: u64) -> Option<String> {
        self.take_counts();
        let child = self.workers[index].child.take()?;
        let Worker { process, greeted, .. } = self.workers[index];
        let reason = self.reap_and_reconnect(child, Some(process), greeted);
        let worker = &mut self.workers[index];
        worker.went = false;
        match worker.restarts.failed(now) {
            Answer::GiveUp(why) => Some(format!("{reason}; {why}")),
            Answer::RestartAt { at } => {
                worker.due = Some(at);
                None
            }
        }
    }

    fn restart(&mut self, index: usize) -> Result<(), ChildError> {
        self.workers[index].due = None;
        // What it took last is read before its node is cleaned; what came with the cleaning of another, here.
        self.read_journals();
        for operator in self.graph.processes[self.workers[index].process].operators.clone() {
            self.incarnations[operator] += 1;
        }
        let child = self.start_worker(index)?;
        let (name, pid) = (child.name.clone(), child.pid());
        self.workers[index].child = Some(child);
        self.say(Level::Warn, &name, format!("starts again as process {pid}"));
        Ok(())
    }

    /// A recorder that dies is started again and goes on in the next part of the session, with what the publishers kept
    /// since the last flush. The run does not end by it; the session says what is missing nevertheless.
    fn reap_recorder(&mut self, now: u64) {
        let Some(child) = self.recorder.take() else { return };
        self.recorder_exit = Some(self.reap_and_reconnect(child, None, 0));
        self.recorder_deaths += 1;
        if let Answer::RestartAt { at } = self.recorder_restarts.failed(now) {
            self.recorder_due = Some(at);
        }
    }

    /// Starts a recorder that died at once, also before its restart is due: the run ends, and with the publishers goes
    /// what they keep for it. Whether another was started.
    pub(super) fn restart_dead_recorder(&mut self) -> bool {
        self.listen();
        if self.recorder.as_ref().is_some_and(Child::is_gone) {
            self.reap_recorder(self.clock.now());
        }
        if self.recorder.is_some() || self.options.session.is_none() {
            return false;
        }
        self.recorder_due = None;
        let started = self.start_recorder();
        if let Err(error) = &started {
            self.recorder_exit = Some(error.to_string());
        }
        started.is_ok()
    }

    /// Processes whose ports are made since the last look: everyone connects to them, then they begin.
    fn start_ready_processes(&mut self) {
        let is_new = |w: &Worker| !w.went && w.child.as_ref().is_some_and(|c| c.made);
        let recorder = self.recorder.as_ref().is_some_and(|r| r.made && r.ordered == 0);
        if !recorder && !self.workers.iter().any(is_new) {
            return;
        }
        let number = self.connect_all();
        let go = ToWorker::Go { epoch: self.epoch };
        for worker in self.workers.iter_mut().filter(|w| is_new(w)) {
            if let Some(child) = &mut worker.child {
                child.send_message(&go);
                (worker.went, worker.greeted) = (true, number);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sigbus_names_a_full_shared_memory_and_nothing_else_does() {
        let ended = |signal, full: bool| how(Some(ExitStatus::from_raw(signal)), move || full);
        assert!(ended(7, true).contains("SIGBUS") && ended(7, true).contains("/dev/shm is full; make room"));
        assert!(!ended(7, false).contains("/dev/shm") && !ended(9, true).contains("/dev/shm"));
    }

    #[test]
    fn a_recorder_waits_longer_each_time_up_to_a_limit_and_after_a_calm_as_at_first() {
        let mut restarts = of_recorder();
        let mut now = 0;
        let mut wait = |calm: u64| match restarts.failed(now + calm) {
            Answer::RestartAt { at } => {
                let waited = at - now - calm;
                now = at;
                waited
            }
            Answer::GiveUp(why) => panic!("{why}"),
        };
        let waits: Vec<u64> = (0..40).map(|_| wait(1)).collect();
        assert_eq!(waits[..3], [RECORDER_BACKOFF, 2 * RECORDER_BACKOFF, 4 * RECORDER_BACKOFF]);
        assert_eq!(waits[39], RECORDER_LONGEST);
        assert_eq!(wait(11_000_000_000), RECORDER_BACKOFF);
    }
}
