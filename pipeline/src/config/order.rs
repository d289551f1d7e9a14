//! The order of operators: upstream before downstream, and the cycles that have no such order.

use std::collections::{BTreeMap, BTreeSet};

use super::document::Document;
use super::faults::{Code, Findings};
use super::wiring::Wired;

/// Numbers of operators, upstream first, ties in the order of the file. Edges with a delay do not count. Each cycle
/// that is left is a fault, where the `links` that may cut it stand.
pub fn upstream_first(
    document: &Document<'_>,
    wired: &[Wired],
    links_stand: bool,
    findings: &Findings,
) -> Vec<usize> {
    let mut upstream: Vec<BTreeSet<usize>> = wired
        .iter()
        .map(|w| {
            w.inputs.iter().filter_map(|i| i.edge.filter(|e| e.delay == 0)).map(|e| e.operator).collect()
        })
        .collect();
    let mut order = settle(&mut upstream, None);
    while order.len() < wired.len() && links_stand && !findings.is_full() {
        let cycle = cycle(&upstream);
        if cycle.is_empty() {
            break;
        }
        report(document, wired, &cycle, findings);
        order.extend(settle(&mut upstream, Some(&cycle)));
    }
    order
}

/// What a settled operator waits for: nothing, ever.
fn is_settled(waits: &BTreeSet<usize>) -> bool {
    waits.contains(&usize::MAX)
}

/// Takes operators that wait for nothing until none is left; `broken` ones are taken first, whatever they wait for.
fn settle(upstream: &mut [BTreeSet<usize>], broken: Option<&[usize]>) -> Vec<usize> {
    let mut downstream: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (i, waits) in upstream.iter().enumerate() {
        for w in waits {
            downstream.entry(*w).or_default().push(i);
        }
    }
    let mut ready: BTreeSet<usize> = match broken {
        Some(cycle) => cycle.iter().copied().collect(),
        None => (0..upstream.len()).filter(|i| upstream[*i].is_empty()).collect(),
    };
    let mut order = Vec::new();
    while let Some(next) = ready.pop_first() {
        if is_settled(&upstream[next]) {
            continue;
        }
        upstream[next] = BTreeSet::from([usize::MAX]);
        order.push(next);
        for consumer in downstream.get(&next).into_iter().flatten() {
            if !is_settled(&upstream[*consumer]) {
                upstream[*consumer].remove(&next);
                if upstream[*consumer].is_empty() {
                    ready.insert(*consumer);
                }
            }
        }
    }
    order
}

/// A cycle among the operators that are left, in the direction of the samples, from its first in the file.
fn cycle(upstream: &[BTreeSet<usize>]) -> Vec<usize> {
    let Some(mut at) = upstream.iter().position(|w| !is_settled(w)) else { return Vec::new() };
    let mut path = Vec::new();
    let mut seen = BTreeMap::new();
    loop {
        if let Some(from) = seen.insert(at, path.len()) {
            let mut cycle: Vec<usize> = path.split_off(from);
            cycle.reverse();
            let first = cycle.iter().enumerate().min_by_key(|(_, n)| **n).map_or(0, |(i, _)| i);
            cycle.rotate_left(first);
            return cycle;
        }
        path.push(at);
        match upstream[at].first() {
            Some(next) => at = *next,
            None => return Vec::new(),
        }
    }
}

fn report(document: &Document<'_>, wired: &[Wired], cycle: &[usize], findings: &Findings) {
    let names: Vec<&str> =
        cycle.iter().chain(cycle.first()).map(|i| document.operators[*i].name.value.as_str()).collect();
    let shown = if names.len() > 10 {
        format!("{} → … → {}", names[..8].join(" → "), names[names.len() - 1])
    } else {
        names.join(" → ")
    };
    // The edge that goes back to the first operator is the feedback: a delay belongs there.
    let (Some(&consumer), Some(&producer)) = (cycle.first(), cycle.last()) else { return };
    let input = wired[consumer]
        .inputs
        .iter()
        .find(|i| i.edge.is_some_and(|e| e.operator == producer && e.delay == 0));
    let Some(input) = input else { return };
    let Some(stage) = &wired[consumer].stage else { return };
    let port = wired[consumer].inputs.iter().position(|i| i.span == input.span).unwrap_or(0);
    let port = stage.kind.inputs[port].name;
    let output =
        input.edge.and_then(|e| wired[e.operator].stage.as_ref().map(|s| s.kind.outputs[e.output].name));
    let topic = format!("{}.{}", document.operators[producer].name.value, output.unwrap_or("port"));
    findings.say(
        input.span,
        Code::Cycle,
        format!("these operators wait for each other without a delay: {shown}"),
        format!("delay one edge of the cycle, for example `{port}: {{ from: {topic}, delay: 10 ms }}`"),
    );
}
