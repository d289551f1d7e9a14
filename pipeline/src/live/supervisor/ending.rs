//! The end of a run, level by level.

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use super::Supervisor;
use super::connecting::POLL_INTERVAL;
use crate::graph::Graph;
use crate::ledger::LedgerLine;
use crate::live::barrier::PATIENCE;
use crate::live::children::Child;
use crate::live::control::{FromWorker, RecorderReport, ToRecorder, ToWorker};
use crate::live::log::Level;
use crate::live::report::{Recorded, Run, RunReport};

/// How long the processes of a level may take to drain their inputs and mark their ends.
const STOP_PATIENCE: Duration = Duration::from_secs(10);

/// Why the session of a run is not ended.
struct RecordingFailed(String);

/// The signals that arrive while a run ends. The first signal stops the run in order; each further signal abandons the
/// current wait, and no later one.
struct StopSignals<'s> {
    stop: &'s AtomicBool,
    asked: bool,
}

impl<'s> StopSignals<'s> {
    fn new(stop: &'s AtomicBool) -> Self {
        let asked = stop.swap(false, Ordering::Relaxed);
        Self { stop, asked }
    }

    /// Whether a signal abandons the current wait. The signal is used up by that.
    fn abandon_wait(&mut self) -> bool {
        self.stop.swap(false, Ordering::Relaxed) && std::mem::replace(&mut self.asked, true)
    }
}

impl Supervisor {
    /// Ends the run in order: level by level, the recorder last.
    pub(super) fn end(
        mut self,
        early: Option<String>,
        stopped: u64,
        stop: &AtomicBool,
        run: &mut dyn Run,
    ) -> RunReport {
        let why =
            early.clone().unwrap_or_else(|| "its time is over, or its sources have finished".to_owned());
        self.say(Level::Info, "supervisor", format!("the run ends: {why}"));
        let mut signals = StopSignals::new(stop);
        let mut late = Vec::new();
        for level in levels(&self.graph) {
            late.extend(self.end_level(&level, &mut signals));
        }
        let early = match (early, late.is_empty()) {
            (early, true) => early,
            (_, false) => Some(format!("{} did not stop on request, and was killed", late.join(", "))),
        };
        let mut records = self.connect_recorder(&mut signals);
        if !records && self.restart_dead_recorder() {
            records = self.connect_recorder(&mut signals);
        }
        self.read_journals();
        self.report_faults(run);
        self.take_counts();
        let mut ledger = self.ledger.lines(&self.graph);
        if self.bridge.is_some() {
            ledger.extend(self.bridged.lines(&self.graph, &mut self.ledger));
        }
        let balanced = ledger.iter().all(LedgerLine::balances);
        let mut report = RunReport {
            pipeline: self.graph.name.clone(),
            seconds: stopped.saturating_sub(self.epoch) as f64 / 1e9,
            operators: self.status.figures(),
            ledger,
            balanced,
            unseen_entries: self.ledger.missing_entries(),
            faults: Vec::new(),
            ended_early: early,
            recorded: Vec::new(),
            recording_failed: None,
            swept: std::mem::take(&mut self.swept),
        };
        match self.finish_recording(&report, records, &mut signals) {
            Ok(recorded) => report.recorded.extend(recorded.map(|recorded| self.without_unsent(recorded))),
            Err(failed) => report.recording_failed = Some(failed.0),
        }
        for worker in &mut self.workers {
            if let Some(mut child) = worker.child.take() {
                child.send_message(&ToWorker::Exit);
                child.reap(Duration::from_secs(10));
            }
        }
        self.report_faults(run);
        report.faults = std::mem::take(&mut self.faults);
        report
    }

    /// The recorder counts each number that did not come as lost; those of samples that were never sent are not.
    fn without_unsent(&self, mut recorded: Recorded) -> Recorded {
        for (operator, node) in self.graph.operators.iter().enumerate() {
            for (port, output) in node.outputs.iter().enumerate() {
                if let Some(lost) = recorded.lost.get_mut(&output.topic) {
                    *lost = lost.saturating_sub(self.ledger.total_unsent(operator, port));
                }
            }
        }
        recorded.lost.retain(|_, lost| *lost > 0);
        recorded
    }

    /// Stops the processes of a level, and kills those that do not stop in time. Gives the names of those.
    fn end_level(&mut self, level: &[usize], signals: &mut StopSignals) -> Vec<String> {
        for index in level {
            if let Some(child) = &mut self.workers[*index].child {
                child.send_message(&ToWorker::Stop);
            }
        }
        let begun = Instant::now();
        while let Some(index) = level.iter().find(|index| self.is_stopping(**index))
            && begun.elapsed() < STOP_PATIENCE
            && !signals.abandon_wait()
        {
            self.read_journals();
            if let Some(child) = &mut self.workers[*index].child {
                child.wait(POLL_INTERVAL, &mut self.reported, |c| c.stopped);
            }
        }
        // Other processes may have stopped during the wait for one.
        self.listen();
        let mut late = Vec::new();
        for index in level {
            if self.is_stopping(*index)
                && let Some(mut child) = self.workers[*index].child.take()
            {
                child.kill();
                late.push(child.name.clone());
                child.reap(Duration::from_secs(1));
            }
        }
        self.read_journals();
        late
    }

    /// Has every process connect for the last time, and the recorder with them. Whether the recorder has.
    fn connect_recorder(&mut self, signals: &mut StopSignals) -> bool {
        // A publisher hands over what it keeps when it connects: the recorder's ports are there before.
        self.wait_for_recorder_ports(|| signals.abandon_wait());
        let number = self.connect_all();
        self.wait_for_recorder(number, || signals.abandon_wait())
    }

    /// The gaps of the session that the supervisor knows of. Samples that a recorder lost when it died are counted by
    /// their numbers, in the session.
    fn gaps(&self, report: &RunReport) -> Vec<String> {
        (!report.balanced).then(|| "the ledger does not balance".to_string()).into_iter().collect()
    }

    /// Whether a worker was ordered to stop and runs on. A worker that never began has nothing to stop.
    fn is_stopping(&self, index: usize) -> bool {
        let worker = &self.workers[index];
        worker.went && worker.child.as_ref().is_some_and(|c| !c.stopped && !c.is_gone())
    }

    /// Has the recorder end the session. `answers`: the recorder has answered its last order. Gives the reason for which
    /// the last part has no end.
    fn finish_recording(
        &mut self,
        report: &RunReport,
        answers: bool,
        signals: &mut StopSignals,
    ) -> Result<Option<Recorded>, RecordingFailed> {
        if self.options.session.is_none() {
            return Ok(None);
        }
        let Some(mut recorder) = self.recorder.take() else {
            let exit = self.recorder_exit.take();
            return Err(RecordingFailed(exit.unwrap_or_else(|| "there is no recorder".to_string())));
        };
        if answers {
            let ledger = serde_json::to_string_pretty(&report.ledger).unwrap_or_default();
            recorder.send_message(&ToRecorder::Finish {
                ledger,
                gaps: self.gaps(report),
                recorder_deaths: self.recorder_deaths,
                ended_early: report.ended_early.clone().filter(|reason| reason != "stopped"),
            });
        }
        let begun = Instant::now();
        // Many samples may wait for a slow disk, so the recorder has more time than the workers. A signal abandons the wait.
        while answers && !recorder.is_gone() && begun.elapsed() < PATIENCE && !signals.abandon_wait() {
            recorder.wait(POLL_INTERVAL, &mut self.reported, Child::has_answered);
            while let Some(message) = recorder.next() {
                if let FromWorker::Recorded(RecorderReport { samples, bytes, cpu_ns, lost, part }) = message {
                    recorder.reap(STOP_PATIENCE);
                    return Ok(Some(Recorded { part, samples, bytes, cpu_ns, lost }));
                }
            }
        }
        if !recorder.is_gone() {
            recorder.kill_unresponsive(recorder.silence().max(begun.elapsed()));
        }
        Err(RecordingFailed(self.reap(recorder)))
    }
}

/// Processes by level: each after all that feed it. Processes that feed each other are in one level. The bridge is the
/// last: it carries what the others have sent.
fn levels(graph: &Graph) -> Vec<Vec<usize>> {
    let count = graph.processes.len();
    let mut feeds = vec![BTreeSet::new(); count];
    for node in &graph.operators {
        for (_, edge) in node.fed() {
            feeds[graph.operators[edge.operator].process].insert(node.process);
        }
    }
    // Reachability is enough for graphs of this size, and gives loops as sets that reach each other.
    let reach: Vec<BTreeSet<usize>> = (0..count)
        .map(|start| {
            let (mut seen, mut todo) = (BTreeSet::new(), vec![start]);
            while let Some(at) = todo.pop() {
                for next in &feeds[at] {
                    if seen.insert(*next) {
                        todo.push(*next);
                    }
                }
            }
            seen
        })
        .collect();
    let mut left: BTreeSet<usize> = (0..count).collect();
    let mut levels = Vec::new();
    while !left.is_empty() {
        // Ready: everything that feeds it and is still left is fed by it, too.
        let ready: Vec<usize> = left
            .iter()
            .copied()
            .filter(|p| left.iter().all(|q| p == q || !reach[*q].contains(p) || reach[*p].contains(q)))
            .collect();
        for p in &ready {
            left.remove(p);
        }
        levels.push(ready);
    }
    let is_bridge = |p: &usize| graph.processes[*p].operators.is_empty();
    let bridge: Vec<usize> = (0..count).filter(is_bridge).collect();
    if !bridge.is_empty() {
        levels.iter_mut().for_each(|level| level.retain(|p| !is_bridge(p)));
        levels.push(bridge);
    }
    levels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_signal_of_a_run_hurries_nobody_and_each_further_one_those_who_are_waited_for() {
        // It ended by a signal, or by itself.
        for stopped in [true, false] {
            let stop = AtomicBool::new(stopped);
            let mut signals = StopSignals::new(&stop);
            assert!(!signals.abandon_wait());
            let mut send = || {
                stop.store(true, Ordering::Relaxed);
                signals.abandon_wait()
            };
            assert_eq!([send(), send()], [stopped, true]);
            assert!(!signals.abandon_wait(), "the next is waited for");
        }
    }
}
