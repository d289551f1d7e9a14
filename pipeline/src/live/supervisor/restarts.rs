//! What follows on the death of a child.

use std::time::Duration;

use super::{Supervisor, Worker};
use crate::live::children::{Child, Told};
use crate::live::control::ToWorker;
use crate::restarts::Answer;

/// Wait before the recorder is started again, ns; it doubles each time, up to [`RECORDER_LONGEST`].
const RECORDER_BACKOFF: u64 = 10_000_000;
/// Longest wait before the recorder is started again, ns.
const RECORDER_LONGEST: u64 = 5_000_000_000;

impl Supervisor {
    /// Buries the dead and starts again what is due. Says why the run cannot go on, if it cannot.
    pub(super) fn care_for_children(&mut self, now: u64) -> Result<Option<String>, String> {
        for index in 0..self.workers.len() {
            if let Some(reason) = self.answer_panics(index, now) {
                return Ok(Some(reason));
            }
            if self.workers[index].child.as_ref().is_some_and(Child::is_gone)
                && let Some(reason) = self.bury_worker(index, now)
            {
                return Ok(Some(reason));
            }
        }
        if self.recorder.as_ref().is_some_and(Child::is_gone) {
            self.bury_recorder(now);
        }
        if self.recorder_due.is_some_and(|due| due <= now) {
            self.recorder_due = None;
            self.start_recorder()?;
        }
        for index in 0..self.workers.len() {
            if self.workers[index].due.is_some_and(|due| due <= now) {
                self.restart(index)?;
            }
        }
        self.greet_the_new();
        Ok(None)
    }

    /// Tells operators that panicked when they begin again. Says why the run ends, if their policy has it so.
    fn answer_panics(&mut self, index: usize, now: u64) -> Option<String> {
        let Worker { child: Some(child), restarts, .. } = &mut self.workers[index] else { return None };
        for (name, said) in std::mem::take(&mut child.panicked) {
            match (restarts.failed(now), self.graph.operator(&name)) {
                (Answer::GiveUp(why), _) => return Some(format!("operator {name}: {said}; {why}")),
                (Answer::Again { at }, Some(operator)) => child.tell(&ToWorker::Renew { operator, at }),
                (Answer::Again { .. }, None) => {}
            }
        }
        None
    }

    /// Everyone connects to what a dead process left, and only then its node is cleaned.
    fn clean_after(&mut self, child: Child) -> String {
        let name = child.name.clone();
        let status = child.reap(Duration::from_secs(1));
        let reason =
            format!("process {name} ended: {}", status.map_or("unknown".to_string(), |s| s.to_string()));
        self.told.push(Told { operator: name, incarnation: 0, reason: reason.clone(), fatal: true });
        self.connect_all();
        self.read_journals();
        self.domain.clean_dead_nodes();
        reason
    }

    /// A worker is gone: its restart is planned, if its policy allows one.
    fn bury_worker(&mut self, index: usize, now: u64) -> Option<String> {
        let mut child = self.workers[index].child.take()?;
        let said = child.last_words.take().map_or_else(String::new, |said| format!(" ({said})"));
        let reason = self.clean_after(child);
        let worker = &mut self.workers[index];
        worker.went = false;
        match worker.restarts.failed(now) {
            Answer::GiveUp(why) => Some(format!("{reason}{said}; {why}")),
            Answer::Again { at } => {
                worker.due = Some(at);
                None
            }
        }
    }

    fn restart(&mut self, index: usize) -> Result<(), String> {
        self.workers[index].due = None;
        for operator in self.graph.processes[self.workers[index].process].operators.clone() {
            self.lives[operator] += 1;
        }
        let child = self.start_worker(index)?;
        self.workers[index].child = Some(child);
        Ok(())
    }

    /// A recorder that dies goes on in the next part of the session. The run does not end by it: the session says what
    /// is missing.
    fn bury_recorder(&mut self, now: u64) {
        let Some(child) = self.recorder.take() else { return };
        self.clean_after(child);
        let wait = RECORDER_BACKOFF.saturating_mul(1 << self.recorder_deaths.min(16)).min(RECORDER_LONGEST);
        self.recorder_deaths += 1;
        self.recorder_due = Some(now.saturating_add(wait));
    }

    /// Processes whose ports are made since the last look: everyone connects to them, then they begin.
    fn greet_the_new(&mut self) {
        let is_new = |w: &Worker| !w.went && w.child.as_ref().is_some_and(|c| c.made);
        let recorder = self.recorder.as_ref().is_some_and(|r| r.made && r.connected == 0);
        if !recorder && !self.workers.iter().any(is_new) {
            return;
        }
        self.connect_all();
        let go = ToWorker::Go { epoch: self.epoch };
        for worker in self.workers.iter_mut().filter(|w| is_new(w)) {
            if let Some(child) = &mut worker.child {
                child.tell(&go);
                worker.went = true;
            }
        }
    }
}
