//! The end of a run, level by level.

use std::collections::BTreeSet;
use std::time::Duration;

use super::{PATIENCE, Supervisor};
use crate::graph::Graph;
use crate::ledger::Line;
use crate::live::children::Told;
use crate::live::control::{FromWorker, RecorderReport, ToRecorder, ToWorker};
use crate::live::report::{Recorded, Run, RunReport};

impl Supervisor {
    /// Ends the run in order: level by level, the recorder last.
    pub(super) fn end(
        mut self,
        early: Option<String>,
        stopped: u64,
        run: &mut dyn Run,
    ) -> Result<RunReport, String> {
        for level in levels(&self.graph) {
            for index in &level {
                if let Some(child) = &mut self.workers[*index].child {
                    child.tell(&ToWorker::Stop);
                }
            }
            for index in &level {
                let Some(child) = &mut self.workers[*index].child else { continue };
                let mut answer = child.answer(PATIENCE, &mut self.told);
                while matches!(answer, Ok(ref m) if !matches!(m, FromWorker::Stopped)) {
                    answer = child.answer(PATIENCE, &mut self.told);
                }
                if let Err(reason) = answer {
                    self.told.push(Told {
                        operator: child.name.clone(),
                        incarnation: 0,
                        reason,
                        fatal: true,
                    });
                }
            }
            self.read_journals();
        }
        self.connect_all();
        self.read_journals();
        self.tell_faults(run);
        let ledger = self.ledger.lines(&self.graph);
        let balanced = ledger.iter().all(Line::balances);
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
            swept: std::mem::take(&mut self.swept),
        };
        self.finish_recording(&report);
        for worker in &mut self.workers {
            if let Some(mut child) = worker.child.take() {
                child.tell(&ToWorker::Exit);
                child.reap(Duration::from_secs(10));
            }
        }
        self.tell_faults(run);
        report.faults = std::mem::take(&mut self.faults);
        report.recorded = std::mem::take(&mut self.recorded);
        Ok(report)
    }

    fn finish_recording(&mut self, report: &RunReport) {
        let Some(mut recorder) = self.recorder.take() else { return };
        let ledger = serde_json::to_string_pretty(&report.ledger).unwrap_or_default();
        recorder.tell(&ToRecorder::Finish {
            ledger,
            gaps: Vec::new(),
            in_order: report.ended_early.as_deref().is_none_or(|e| e == "stopped"),
        });
        loop {
            match recorder.answer(PATIENCE, &mut self.told) {
                Ok(FromWorker::Recorded(RecorderReport { samples, bytes, cpu_ns, lost, part })) => {
                    self.recorded.push(Recorded { part, samples, bytes, cpu_ns, lost });
                    break;
                }
                Ok(_) => {}
                Err(reason) => {
                    let operator = "recorder".to_string();
                    self.told.push(Told { operator, incarnation: 0, reason, fatal: true });
                    break;
                }
            }
        }
        recorder.reap(Duration::from_secs(10));
    }
}

/// Processes by level: each after all that feed it. Processes that feed each other are in one level.
fn levels(graph: &Graph) -> Vec<Vec<usize>> {
    let count = graph.processes.len();
    let mut feeds = vec![BTreeSet::new(); count];
    for node in &graph.operators {
        for edge in node.inputs.iter().filter_map(|i| i.edge) {
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
    levels
}
