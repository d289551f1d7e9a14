//! A running pipeline, observed over a window of time.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use stillpoint_pipeline::graph::{Graph, Priority};
use stillpoint_pipeline::ledger::{Ledger, LedgerLine};
use stillpoint_report::graph::Drawing;
use stillpoint_report::trace::{Journals, Trace};
use stillpoint_samples::Entry;

use super::snapshot::{Parts, ProcessRow, RecorderRow, Snapshot, figures};
use crate::attach::Attached;
use crate::exit::Failure;
use crate::held::{HeldTaps, Read};
use crate::journals::JournalTaps;
use crate::processes;
use crate::rates::of_run;
use crate::settings::Values;

/// A run that is watched.
pub struct Watch {
    window: Duration,
    entries: Vec<Vec<Entry>>,
    ledger: Ledger,
    /// CPU time and time without a core of processes at the time before.
    before: (Instant, BTreeMap<u32, (f64, f64)>),
    begun: Instant,
    // Dropped in this order: ports before the run.
    journals: JournalTaps,
    held: HeldTaps,
    /// Changes of parameters.
    pub settings: Values,
    /// The run.
    pub attached: Attached,
}

impl Watch {
    /// Begins to watch a run; figures are those of the last `window`.
    pub fn open(attached: Attached, window: Duration) -> Result<Self, Failure> {
        let journals = JournalTaps::open(&attached, |_| true)?;
        let held = HeldTaps::open(&attached, Read::All)?;
        let settings = Values::open(&attached)?;
        let entries = vec![Vec::new(); attached.graph.operators.len()];
        let now = Instant::now();
        let before = (now, times(&processes::of_run(attached.pid)));
        let ledger = Ledger::default();
        Ok(Self { window, entries, ledger, before, begun: now, journals, held, settings, attached })
    }

    /// Reads what came since the last look.
    pub fn look(&mut self) -> Result<(), Failure> {
        let (entries, ledger) = (&mut self.entries, &mut self.ledger);
        self.journals.look(&mut |operator, entry| {
            ledger.enter(operator, &entry);
            entries[operator].push(entry);
        })?;
        self.held.look();
        self.settings.look()
    }

    /// The picture of the pipeline with what the window measured. `whole` has the edges of links, which are cut in a run.
    pub fn drawing(&self, whole: Option<&Graph>) -> Drawing {
        Drawing::of(&Journals::of_run(&self.attached.graph, &self.entries), whole)
    }

    /// The paths of the window, from sources to sinks.
    pub fn trace(&self) -> Trace {
        Trace::of(&Journals::of_run(&self.attached.graph, &self.entries), |_, _| true)
    }

    /// The account of every edge since the run began.
    pub fn ledger(&self) -> Vec<LedgerLine> {
        self.ledger.lines(&self.attached.graph)
    }

    /// The figures of the window that ends now.
    pub fn snapshot(&mut self) -> Result<Snapshot, Failure> {
        self.look()?;
        let newest = self.entries.iter().filter_map(|e| e.last()).map(|e| e.header.stamp).max().unwrap_or(0);
        let from = newest.saturating_sub(self.window.as_nanos() as u64);
        for entries in &mut self.entries {
            let old = entries.partition_point(|e| e.header.stamp < from);
            entries.drain(..old);
        }
        let graph = &self.attached.graph;
        let figures = figures(graph, &self.entries);
        let held = self.held.look();
        let parts = Parts {
            of: of_run(&self.attached),
            graph,
            journals: Journals::of_run(graph, &self.entries),
            seconds: self.begun.elapsed().min(self.window).as_secs_f64(),
            verdict: self.held.answers.verdict(graph, &figures),
            figures,
            held: Some(held),
            processes: Some(rows(&self.attached, &mut self.before)),
            changed: self.settings.changed(graph),
            recorder: self.attached.session.as_deref().map(RecorderRow::of),
            clock_set_s: Some(self.attached.card.clock.set_ahead() as f64 * 1e-9),
        };
        Ok(Snapshot::of(parts))
    }
}

fn times(all: &[processes::ProcessState]) -> BTreeMap<u32, (f64, f64)> {
    all.iter().filter_map(|p| Some((p.pid, (p.cpu_s?, p.delayed_s?)))).collect()
}

/// The processes with what they took since the time before.
fn rows(attached: &Attached, before: &mut (Instant, BTreeMap<u32, (f64, f64)>)) -> Vec<ProcessRow> {
    let found = processes::of_run(attached.pid);
    let passed = before.0.elapsed().as_secs_f64();
    let now = times(&found);
    let share = |pid: u32, of: fn(&(f64, f64)) -> f64| {
        let (then, now) = (before.1.get(&pid)?, now.get(&pid)?);
        (passed > 0.0).then(|| 100.0 * (of(now) - of(then)) / passed)
    };
    let rows = found
        .iter()
        .map(|state| {
            let asked = attached.graph.processes.iter().find(|p| p.name == state.name).map(|p| p.priority);
            ProcessRow {
                cpu_percent: share(state.pid, |t| t.0),
                delayed_percent: share(state.pid, |t| t.1),
                asked: asked.unwrap_or(Priority::Normal).full(),
                state: state.clone(),
            }
        })
        .collect();
    *before = (Instant::now(), now);
    rows
}
