//! What follows on the death of a child.

use std::time::Duration;

use super::{PATIENCE, Supervisor};
use crate::graph::Restart;
use crate::live::children::Child;
use crate::live::control::{FromWorker, ToWorker};
use crate::live::report::Fault;

/// After this long without a fault, ns, restarts count from zero again.
const CALM: u64 = 10_000_000_000;

impl Supervisor {
    /// Buries the dead and starts again what is due. Says why the run cannot go on, if it cannot.
    pub(super) fn care_for_children(&mut self, now: u64) -> Result<Option<String>, String> {
        for index in 0..self.workers.len() {
            if self.workers[index].child.as_ref().is_some_and(Child::is_gone)
                && let Some(reason) = self.bury_worker(index, now)
            {
                return Ok(Some(reason));
            }
        }
        if self.recorder.as_ref().is_some_and(Child::is_gone)
            && let Some(reason) = self.replace_recorder()?
        {
            return Ok(Some(reason));
        }
        for index in 0..self.workers.len() {
            if self.workers[index].due.is_some_and(|due| due <= now) {
                self.restart(index)?;
            }
        }
        Ok(None)
    }

    /// A worker is gone: everyone connects to what it left, its node is cleaned, and its restart is planned.
    fn bury_worker(&mut self, index: usize, now: u64) -> Option<String> {
        let worker = &mut self.workers[index];
        let child = worker.child.take()?;
        let name = child.name.clone();
        let status = child.reap(Duration::from_secs(1));
        let reason =
            format!("process {name} ended: {}", status.map_or("unknown".to_string(), |s| s.to_string()));
        self.faults.push(Fault { operator: name.clone(), reason: reason.clone(), fatal: true });
        self.connect_all();
        self.read_journals();
        self.domain.clean_dead_nodes();
        let worker = &mut self.workers[index];
        if now.saturating_sub(worker.last_death) > CALM {
            worker.restarts = 0;
        }
        worker.last_death = now;
        let last = self.faults.iter().rev().nth(1).filter(|f| f.fatal).map(|f| format!(" ({})", f.reason));
        match self.graph.processes[worker.process].restart {
            Restart::Never => {
                Some(format!("{reason}{}; its restart policy is never", last.unwrap_or_default()))
            }
            Restart::OnFault { limit, .. } if worker.restarts >= limit => {
                Some(format!("{reason}{}; it was restarted {limit} times already", last.unwrap_or_default()))
            }
            Restart::OnFault { backoff, .. } => {
                let wait = backoff.saturating_mul(1 << worker.restarts.min(16));
                worker.restarts += 1;
                worker.due = Some(now.saturating_add(wait));
                None
            }
        }
    }

    /// Starts a worker again. One that dies before its ports are made is buried like any other.
    fn restart(&mut self, index: usize) -> Result<(), String> {
        self.workers[index].due = None;
        for operator in self.graph.processes[self.workers[index].process].operators.clone() {
            self.lives[operator] += 1;
        }
        let mut child = self.start_worker(index)?;
        let made = matches!(child.answer(PATIENCE, &mut self.told), Ok(FromWorker::Made));
        if !made {
            child.kill();
        }
        self.workers[index].child = Some(child);
        if made {
            self.connect_all();
            if let Some(child) = &mut self.workers[index].child {
                child.tell(&ToWorker::Go { epoch: self.epoch });
            }
        }
        Ok(())
    }

    /// A recorder that dies goes on in the next part of the session.
    fn replace_recorder(&mut self) -> Result<Option<String>, String> {
        if let Some(child) = self.recorder.take() {
            let status = child.reap(Duration::from_secs(1));
            let reason =
                format!("the recorder ended: {}", status.map_or("unknown".to_string(), |s| s.to_string()));
            self.faults.push(Fault { operator: "recorder".to_string(), reason, fatal: true });
        }
        self.domain.clean_dead_nodes();
        self.recorder_deaths += 1;
        if self.recorder_deaths > 100 {
            return Ok(Some("the recorder ended again and again".to_string()));
        }
        self.start_recorder()?;
        if let Some(recorder) = &mut self.recorder
            && !matches!(recorder.answer(PATIENCE, &mut self.told), Ok(FromWorker::Made))
        {
            let said = self.told.last().map(|t| t.reason.clone());
            return Ok(Some(said.unwrap_or_else(|| "the recorder cannot be started again".to_string())));
        }
        self.connect_all();
        Ok(None)
    }
}
