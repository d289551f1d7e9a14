//! What a run looks like from its journals: counts, rates, latencies.

use hdrhistogram::Histogram;
use serde::Serialize;
use stillpoint_samples::{Cause, Entry, Outcome, RefKind};

use crate::graph::Graph;

/// Running figures of every operator.
pub struct Status {
    operators: Vec<OperatorCounts>,
    first: u64,
    last: u64,
}

struct OperatorCounts {
    name: String,
    activations: u64,
    errors: u64,
    panics: u64,
    incarnations: u32,
    sent: u64,
    sent_by_output: Vec<u64>,
    lost: u64,
    lost_by_port: Vec<(u32, u32, u64)>,
    ticks: u64,
    missed: u64,
    /// Incarnation and number of the timer's last tick.
    tick: Option<(u32, u64)>,
    // A histogram that resizes itself takes every value.
    /// From the activation's time to the sending of its outputs, ns.
    step: Histogram<u64>,
    /// From the acquisition behind it to the sending of its outputs, ns.
    age: Histogram<u64>,
    /// Stamp and origin of the entry before, until it is known when its outputs were sent.
    before: Option<(u32, u64, u64)>,
}

/// OperatorCounts of one operator over a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OperatorFigures {
    /// Name of the operator.
    pub operator: String,
    /// Activations.
    pub activations: u64,
    /// Activations per second of the run.
    pub rate_hz: f64,
    /// Activations that returned an error.
    pub errors: u64,
    /// Activations that panicked.
    pub panics: u64,
    /// Incarnations.
    pub incarnations: u32,
    /// Samples sent.
    pub sent: u64,
    /// The same by output.
    pub sent_by_output: Vec<u64>,
    /// Samples on its inputs that were pushed out by newer ones.
    pub lost: u64,
    /// Activations by its timer.
    pub ticks: u64,
    /// Ticks of its timer that passed while it was busy, or its process got no time.
    pub missed: u64,
    /// Time from the activation to the sending of its outputs, ms: median, 99th percentile.
    pub step_ms: [f64; 2],
    /// Time from the acquisition of the oldest sensor sample behind the outputs to their sending, ms: median, 99th
    /// percentile.
    pub age_ms: [f64; 2],
}

impl Status {
    /// The figures of a graph, before anything happened.
    pub fn new(graph: &Graph) -> Self {
        let histogram =
            || Histogram::new(3).unwrap_or_else(|_| unreachable!("3 significant digits are supported"));
        let operators = graph.operators.iter().map(|node| OperatorCounts {
            name: node.name.clone(),
            activations: 0,
            errors: 0,
            panics: 0,
            incarnations: 0,
            sent: 0,
            sent_by_output: vec![0; node.outputs.len()],
            lost: 0,
            lost_by_port: Vec::new(),
            ticks: 0,
            missed: 0,
            tick: None,
            step: histogram(),
            age: histogram(),
            before: None,
        });
        Self { operators: operators.collect(), first: u64::MAX, last: 0 }
    }

    /// Takes an entry.
    pub fn enter(&mut self, operator: usize, entry: &Entry) {
        let f = &mut self.operators[operator];
        if let Some((incarnation, stamp, origin)) = f.before.take()
            && incarnation == entry.header.incarnation
            && entry.body.sent_before > stamp
        {
            let sent = entry.body.sent_before;
            let _ = f.step.record(sent - stamp);
            let _ = f.age.record(sent.saturating_sub(origin));
        }
        match entry.cause() {
            Some(Cause::Start) => {
                f.incarnations += 1;
                return;
            }
            Some(Cause::End) | None => return,
            Some(_) => {}
        }
        if entry.cause() == Some(Cause::Timer) {
            f.ticks += 1;
            let now = (entry.header.incarnation, entry.body.tick);
            if let Some((incarnation, tick)) = f.tick.replace(now)
                && incarnation == now.0
            {
                f.missed += now.1.saturating_sub(tick + 1);
            }
        }
        self.first = self.first.min(entry.header.stamp);
        self.last = self.last.max(entry.header.stamp);
        f.activations += u64::from(entry.cause() != Some(Cause::Set));
        match entry.outcome() {
            Some(Outcome::Error) => f.errors += 1,
            Some(Outcome::Panic) => f.panics += 1,
            _ => {}
        }
        for r in &entry.refs {
            if r.kind == RefKind::Output as u32 {
                f.sent += u64::from(r.count);
                if let Some(sent) = f.sent_by_output.get_mut(r.port as usize) {
                    *sent += u64::from(r.count);
                }
                continue;
            }
            // Totals start anew with each incarnation on either side.
            match f.lost_by_port.iter_mut().find(|(port, life, _)| (*port, *life) == (r.port, r.incarnation))
            {
                Some((_, _, lost)) => {
                    f.lost += r.lost.saturating_sub(*lost);
                    *lost = r.lost;
                }
                None => {
                    f.lost += r.lost;
                    f.lost_by_port.push((r.port, r.incarnation, r.lost));
                }
            }
        }
        f.before = Some((entry.header.incarnation, entry.header.stamp, entry.header.origin));
    }

    /// The figures now.
    pub fn figures(&self) -> Vec<OperatorFigures> {
        let seconds = self.last.saturating_sub(self.first) as f64 / 1e9;
        let quantiles = |h: &Histogram<u64>| {
            if h.is_empty() {
                [f64::NAN; 2]
            } else {
                [h.value_at_quantile(0.5) as f64 / 1e6, h.value_at_quantile(0.99) as f64 / 1e6]
            }
        };
        let figures = self.operators.iter().map(|f| OperatorFigures {
            operator: f.name.clone(),
            activations: f.activations,
            rate_hz: if seconds > 0.0 { f.activations.saturating_sub(1) as f64 / seconds } else { 0.0 },
            errors: f.errors,
            panics: f.panics,
            incarnations: f.incarnations,
            sent: f.sent,
            sent_by_output: f.sent_by_output.clone(),
            lost: f.lost,
            ticks: f.ticks,
            missed: f.missed,
            step_ms: quantiles(&f.step),
            age_ms: quantiles(&f.age),
        });
        figures.collect()
    }
}
