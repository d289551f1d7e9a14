//! What is wrong with a run or a session, in words.

use std::collections::BTreeSet;

use stillpoint_pipeline::graph::Graph;
use stillpoint_report::trace::Journals;
use stillpoint_samples::RefKind;

use super::snapshot::Snapshot;

/// The share of ticks or samples from which on a loss is a trouble.
const MUCH: f64 = 0.05;
/// Free space below which a disk is nearly full.
const LITTLE: u64 = 1 << 30;
/// Free space below which nothing more is recorded.
const NOTHING: u64 = 1 << 20;
/// Activations that hold the same sample, from which on its topic has stopped.
const HELD: u64 = 10;
/// The share of the time without a core from which on a process is starved, per cent.
const STARVED: f64 = 10.0;

/// The word of valves whose far end is silent.
const NO_ANSWER: &str = "no answer";
/// How far a clock may be set before it is a trouble, s: a service that keeps time moves it by less.
const CLOCK_JUMP: f64 = 0.5;

/// The troubles, the gravest kind first.
pub fn of(snapshot: &Snapshot, graph: &Graph, journals: &Journals<'_>) -> Vec<String> {
    let mut found = processes(snapshot);
    for o in &snapshot.operators {
        let f = &o.figures;
        if o.state == "down" || o.state == "suspended" || o.state == "silent" {
            found.push(format!("{}: {}", o.operator, o.state));
        }
        let failed = f.errors + f.panics;
        if failed > 0 {
            found.push(format!("{}: {failed} of {} activations failed", o.operator, f.activations));
        }
        if o.restarts > 0 {
            found.push(format!("{}: restarted, {} times", o.operator, o.restarts));
        }
        if f.missed as f64 > MUCH * (f.ticks + f.missed) as f64 {
            let step = if f.step_ms[0].is_finite() {
                format!("; a step takes {:.1} ms (p99 {:.1} ms)", f.step_ms[0], f.step_ms[1])
            } else {
                String::new()
            };
            found.push(format!("{}: missed {} of {} ticks{step}", o.operator, f.missed, f.ticks + f.missed));
        }
    }
    for edge in &snapshot.edges {
        let node = graph.operators.iter().find(|o| o.name == edge.to);
        let is_queue = node
            .and_then(|n| n.inputs.get(edge.input))
            .is_some_and(|i| !matches!(i.policy, stillpoint_operator::Policy::Latest));
        // An input that takes the newest sample passes over the others by design.
        let lost = if is_queue { edge.lost + edge.passed } else { 0 };
        if lost > 0 && lost as f64 > MUCH * (edge.taken + lost) as f64 {
            found.push(format!(
                "{} -> {}: {lost} of {} samples lost",
                edge.topic,
                edge.to,
                edge.taken + lost
            ));
        }
    }
    let broken = snapshot.contracts.iter().filter(|c| c.is_broken);
    found.extend(broken.map(|contract| format!("contract broken: {contract}")));
    found.extend(stopped(snapshot, graph, journals));
    found.extend(held(snapshot));
    match snapshot.recorder.as_ref().and_then(|r| r.free_bytes) {
        Some(free) if free < NOTHING => {
            found.push(
                "the disk of the session is full, and samples are lost to it: make room on it".to_owned(),
            );
        }
        Some(free) if free < LITTLE => {
            found.push(format!("the disk of the session has {:.2} GB free", free as f64 * 1e-9));
        }
        _ => {}
    }
    if let Some(jump) = snapshot.clock_set_s.filter(|jump| jump.abs() > CLOCK_JUMP) {
        found.push(format!(
            "the clock of this machine was set by {jump:+.1} s since the run began: session time goes on evenly, other \
             hosts and files have another time"
        ));
    }
    found
}

fn processes(snapshot: &Snapshot) -> Vec<String> {
    let mut found = Vec::new();
    for process in &snapshot.processes {
        let name = &process.state.name;
        if process.asked != "normal" && process.asked != process.state.granted {
            found.push(format!(
                "process {name}: asked for priority {}, runs as {}",
                process.asked, process.state.granted
            ));
        }
        if let Some(delayed) = process.delayed_percent.filter(|d| *d > STARVED) {
            found.push(format!("process {name}: waited for a core in {delayed:.0} % of the time"));
        }
    }
    found
}

/// Topics that a consumer holds an old sample of, and the operator that is to blame: the last upstream that is at work.
fn stopped(snapshot: &Snapshot, graph: &Graph, journals: &Journals<'_>) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    let is_at_work = |operator: usize| snapshot.operators[operator].figures.activations > 0;
    for (number, node) in graph.operators.iter().enumerate() {
        let Some(journal) = journals.operators.iter().find(|o| o.stage.name == node.name) else { continue };
        for (port, edge) in node.fed() {
            let count = |kind: RefKind| {
                let of = |r: &&stillpoint_samples::JournalRef| r.port as usize == port && r.count > 0;
                journal.entries.iter().filter(|e| e.refs_of(kind).any(|r| of(&r))).count() as u64
            };
            if count(RefKind::Fresh) > 0 || count(RefKind::Held) < HELD {
                continue;
            }
            // Upstream to the first operator that is at work.
            let (mut from, mut seen) = (edge, BTreeSet::from([number]));
            while !is_at_work(from.operator) && seen.insert(from.operator) {
                let Some((_, next)) = graph.operators[from.operator].fed().next() else { break };
                from = next;
            }
            let cause = &graph.operators[from.operator];
            // Commands of people come when they come.
            if cause.stage.kind.name == stillpoint_pipeline::console::KIND_NAME {
                continue;
            }
            let topic = &cause.outputs[from.output].topic;
            found.insert(format!("{topic}: {} sent nothing in {:.1} s", cause.name, snapshot.seconds));
        }
    }
    found
}

/// Why the beam is off and the valves do not follow.
fn held(snapshot: &Snapshot) -> Vec<String> {
    let mut found = Vec::new();
    let Some(held) = &snapshot.held else { return found };
    for gate in held.gates.iter().filter(|g| !g.on && !g.reasons.is_empty()) {
        found.push(format!("{}: the beam is off: {}", gate.topic, gate.reasons.join(", ")));
    }
    for valves in &held.valves {
        if valves.state == "fault" {
            found.push(format!("{}: fault: {}", valves.topic, valves.fault.join(", ")));
        }
        if valves.reasons.contains(&NO_ANSWER) {
            found.push(format!("{}: the far end acknowledges no order", valves.topic));
        }
        if valves.refused > 0 && !valves.lacking.is_empty() {
            found.push(format!("{}: a command was refused: {}", valves.topic, valves.lacking.join(", ")));
        }
    }
    for far in &held.far_ends {
        let refused = far.refused + far.refused_beam;
        if refused as f64 > MUCH * (far.accepted + refused) as f64 {
            let all = far.accepted + refused;
            found.push(format!("{}: {refused} of {all} orders refused: {}", far.topic, far.why()));
        }
    }
    found
}
