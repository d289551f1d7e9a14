//! The figures of every edge, from the journals.

use serde::Serialize;
use stillpoint_samples::RefKind;

use super::journals::Journals;
use crate::statistics::Spread;
use crate::wiring::is_activation;

/// An edge with what was measured on it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EdgeFigures {
    /// The topic.
    pub topic: String,
    /// The consuming operator.
    pub to: String,
    /// Number of its input.
    #[serde(skip)]
    pub input: usize,
    /// Samples that were taken.
    pub taken: u64,
    /// Samples taken a second.
    pub rate_hz: Option<f64>,
    /// From the sending to the taking.
    pub latency_ms: Spread,
    /// From the acquisition to the taking.
    pub age_ms: Spread,
    /// Samples that were overwritten before they were taken.
    pub lost: u64,
    /// Samples that were passed over.
    pub passed: u64,
}

/// The figures of the connected inputs of all operators.
pub fn edges(journals: &Journals<'_>) -> Vec<EdgeFigures> {
    let mut found = Vec::new();
    for number in 0..journals.operators.len() {
        for input in 0..journals.operators[number].stage.inputs.len() {
            if let Some((producer, output)) = journals.producer(number, input) {
                found.push(edge(journals, (producer, output), (number, input)));
            }
        }
    }
    found
}

fn edge(
    journals: &Journals<'_>,
    (producer, output): (usize, usize),
    (number, input): (usize, usize),
) -> EdgeFigures {
    let (from, node) = (&journals.operators[producer], &journals.operators[number]);
    let (mut taken, mut latencies, mut ages, mut times) = (0, Vec::new(), Vec::new(), Vec::new());
    // Totals of an input start anew with each incarnation on either side.
    let mut totals: Vec<((u32, u32), (u64, u64))> = Vec::new();
    for entry in node.entries {
        for r in entry.refs.iter().filter(|r| r.port as usize == input && r.kind != RefKind::Output as u32) {
            let lives = (entry.header.incarnation, r.incarnation);
            match totals.iter_mut().find(|(of, _)| *of == lives) {
                Some((_, counts)) => *counts = (counts.0.max(r.lost), counts.1.max(r.passed)),
                None => totals.push((lives, (r.lost, r.passed))),
            }
            if r.kind != RefKind::Fresh as u32 || r.count == 0 || !is_activation(entry) {
                continue;
            }
            taken += u64::from(r.count);
            times.push(entry.header.stamp);
            let Some(maker) = from.maker(output, r.incarnation, r.first) else { continue };
            let acquired = from.entries[maker].header.origin;
            ages.push(entry.header.stamp.saturating_sub(acquired) as f64 * 1e-6);
            if let Some(sent) = from.sent(maker) {
                latencies.push(entry.header.stamp.saturating_sub(sent) as f64 * 1e-6);
            }
        }
    }
    let seconds = match (times.first(), times.last()) {
        (Some(first), Some(last)) if last > first => Some((last - first) as f64 * 1e-9),
        _ => None,
    };
    let sum =
        |of: fn(&(u64, u64)) -> u64| totals.iter().map(|(_, counts)| of(counts)).fold(0, u64::saturating_add);
    EdgeFigures {
        topic: node.stage.inputs[input].clone(),
        to: node.stage.name.clone(),
        input,
        taken,
        rate_hz: seconds.map(|s| times.len().saturating_sub(1) as f64 / s),
        latency_ms: Spread::of(latencies),
        age_ms: Spread::of(ages),
        lost: sum(|c| c.0),
        passed: sum(|c| c.1),
    }
}
