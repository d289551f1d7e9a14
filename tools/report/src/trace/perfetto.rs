//! The activations as a trace in the JSON format of Chrome and Perfetto (Trace Event Format).

use serde_json::{Value, json};
use stillpoint_samples::{Outcome, RefKind};

use super::journals::Journals;
use crate::wiring::is_activation;

/// Longest number that is exact in the JSON of every reader.
const MOST_FLOWS: u64 = 1 << 53;

/// A process for each process, a thread for each operator, a slice for each activation with its laps in it, and an arrow
/// from the activation that sent a sample to the one that took it. Times are in us since the first activation.
pub fn perfetto(journals: &Journals<'_>) -> Value {
    let begun = journals.first();
    let us = |ns: u64| ns.saturating_sub(begun) as f64 * 1e-3;
    let mut processes: Vec<&str> = journals.operators.iter().map(|o| o.process.as_str()).collect();
    processes.sort_unstable();
    processes.dedup();
    let mut events = Vec::new();
    for process in &processes {
        events.push(json!({
            "ph": "M", "name": "process_name", "pid": number_of(&processes, process), "tid": 0, "args": { "name": process }
        }));
    }
    let mut flow = 0_u64;
    for (number, operator) in journals.operators.iter().enumerate() {
        let (pid, tid) = (number_of(&processes, &operator.process), number + 1);
        let name = &operator.stage.name;
        events.push(
            json!({ "ph": "M", "name": "thread_name", "pid": pid, "tid": tid, "args": { "name": name } }),
        );
        for (at, entry) in operator.entries.iter().enumerate().filter(|(_, e)| is_activation(e)) {
            let (Some(sent), Some(cause)) = (operator.sent(at), entry.cause()) else { continue };
            let start = entry.header.stamp;
            let outcome = entry.outcome().unwrap_or(Outcome::Error);
            events.push(json!({
                "ph": "X", "name": name, "cat": "step", "pid": pid, "tid": tid,
                "ts": us(start), "dur": sent.saturating_sub(start) as f64 * 1e-3,
                "args": {
                    "activation": entry.body.index, "incarnation": entry.header.incarnation,
                    "cause": cause.word(), "outcome": outcome.word(),
                    "age_ms": start.saturating_sub(entry.header.origin) as f64 * 1e-6,
                }
            }));
            let mut lap_start = start;
            for (lap, time) in journals.laps.get(name).and_then(|l| l.get(&start)).into_iter().flatten() {
                let end = lap_start.saturating_add(*time).min(sent);
                events.push(json!({
                    "ph": "X", "name": lap, "cat": "lap", "pid": pid, "tid": tid,
                    "ts": us(lap_start), "dur": end.saturating_sub(lap_start) as f64 * 1e-3,
                }));
                lap_start = end;
            }
            for r in entry.refs_of(RefKind::Fresh).filter(|r| r.count > 0) {
                let Some((producer, output)) = journals.producer(number, r.port as usize) else { continue };
                let from = &journals.operators[producer];
                let Some(maker) = from.maker(output, r.incarnation, r.first) else { continue };
                if from.sent(maker).is_none() || flow >= MOST_FLOWS {
                    continue;
                }
                flow += 1;
                let topic = &from.stage.outputs[output];
                // An arrow begins and ends within a slice.
                events.push(json!({
                    "ph": "s", "name": topic, "cat": "sample", "id": flow,
                    "pid": number_of(&processes, &from.process), "tid": producer + 1,
                    "ts": us(from.entries[maker].header.stamp),
                }));
                events.push(json!({
                    "ph": "f", "bp": "e", "name": topic, "cat": "sample", "id": flow, "pid": pid, "tid": tid,
                    "ts": us(start),
                }));
            }
        }
    }
    json!({ "displayTimeUnit": "ms", "traceEvents": events })
}

/// Number of a process in the trace.
fn number_of(processes: &[&str], process: &str) -> usize {
    processes.iter().position(|p| *p == process).unwrap_or(0) + 1
}
