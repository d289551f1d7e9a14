//! The section `contracts`, and the bounds of time of inputs and timers: what may take how long. What contradicts itself is
//! refused here; what is broken in a run is counted from its journals.

use super::assemble::output;
use super::document::Document;
use super::faults::{Code, Findings};
use super::fields::{missing, no_choice, period};
use super::inputs::{Topic, topic_at};
use super::near::shown;
use super::source::{Marked, Span};
use super::tree::{Entry, Keys, Node};
use super::wiring::Wired;
use crate::graph::{LateInput, PathContract};

/// Keys of a contract.
pub const KEYS: &[&str] = &["path", "within", "share", "else"];

/// A contract about a path as it was written.
pub struct ParsedContract {
    from: Marked<Topic>,
    to: Marked<Topic>,
    path: Span,
    within: Marked<u64>,
    share: f64,
    is_fault: bool,
}

/// Reads the section.
pub fn read(node: &Node, findings: &Findings) -> Vec<ParsedContract> {
    let expected = "a list of contracts such as `{ path: rig.depth -> law.duties, within: 80 ms }`";
    let Some(items) = node.list("`contracts`", expected, findings) else { return Vec::new() };
    items.iter().filter_map(|item| contract(item, findings)).collect()
}

fn contract(node: &Node, findings: &Findings) -> Option<ParsedContract> {
    let entries = node.map("a contract", "{ path: rig.depth -> law.duties, within: 80 ms }", findings)?;
    let keys = Keys::of(entries, KEYS, "a contract", findings);
    let path = match keys.get("path") {
        Some(entry) => ends(&entry.value, findings),
        None => {
            missing("a contract", "path", "rig.depth -> law.duties", node.span.first(1), findings);
            None
        }
    };
    let within = match keys.get("within") {
        Some(entry) => period(entry, findings),
        None => {
            missing("a contract", "within", "80 ms", node.span.first(1), findings);
            None
        }
    };
    let share = keys.get("share").map_or(Some(1.0), |entry| share(entry, findings));
    let is_fault = match keys.get("else") {
        None => false,
        Some(entry) => {
            let text = entry.value.scalar("`else`", "`count` or `fault`", findings)?;
            if !["count", "fault"].contains(&text) {
                let what = "what follows from a broken contract";
                no_choice(&entry.value, text, what, &["count", "fault"], findings);
            }
            text == "fault"
        }
    };
    let (from, to) = path?;
    Some(ParsedContract {
        path: keys.get("path")?.value.span,
        from,
        to,
        within: within?,
        share: share?,
        is_fault,
    })
}

/// Both ends of `a.b -> c.d`.
fn ends(node: &Node, findings: &Findings) -> Option<(Marked<Topic>, Marked<Topic>)> {
    let text = node.scalar("`path`", "`operator.port -> operator.port`", findings)?;
    let Some((from, to)) = text.split_once("->") else {
        findings.say(
            node.span,
            Code::WrongShape,
            format!("{} is not a path: a path leads from one topic to another", shown(text)),
            "write `rig.depth -> law.duties`",
        );
        return None;
    };
    let from = topic_at(from.trim(), node.span, findings);
    let to = topic_at(to.trim(), node.span, findings);
    from.zip(to)
}

/// A share in per cent, as a fraction.
fn share(entry: &Entry, findings: &Findings) -> Option<f64> {
    let text = entry.value.scalar("`share`", "a share such as `99 %`", findings)?;
    let value = text.trim().strip_suffix('%').and_then(|number| number.trim().parse::<f64>().ok());
    match value {
        Some(percent) if percent > 0.0 && percent <= 100.0 => Some(percent / 100.0),
        _ => {
            findings.say(
                entry.value.span,
                Code::OutOfRange,
                format!("invalid `share`: {} (allowed: above 0 % up to 100 %)", shown(text)),
                "write `99 %`",
            );
            None
        }
    }
}

/// Reads the key `else` of an input with `max_age`.
pub fn late_input(entry: &Entry, findings: &Findings) -> Option<LateInput> {
    const WORDS: &[&str] = &["count", "skip", "hold", "fault"];
    let text = entry.value.scalar("`else`", "`skip`, `hold`, `fault` or `count`", findings)?;
    match text {
        "count" => Some(LateInput::Count),
        "skip" => Some(LateInput::Skip),
        "hold" => Some(LateInput::Hold),
        "fault" => Some(LateInput::Fault),
        other => {
            no_choice(&entry.value, other, "what an operator does about a late input", WORDS, findings);
            None
        }
    }
}

/// Refuses contracts that cannot be kept, and gives the others.
pub fn check(document: &Document<'_>, wired: &[Wired], findings: &Findings) -> Vec<PathContract> {
    for (number, operator) in document.operators.iter().enumerate() {
        if let Some(bound) = &operator.start_within {
            start(operator.every.as_ref().map(|e| e.value), bound, findings);
        }
        for input in &wired[number].inputs {
            let Some(parsed) = input.parsed.and_then(|at| operator.inputs.get(at)) else { continue };
            let (Some(max), Some(edge)) = (&parsed.max_age, input.edge) else { continue };
            let from = &document.operators[edge.operator];
            let every = from.every.as_ref().map_or(0, |e| e.value);
            let least = every.saturating_add(edge.delay).saturating_add(from.latency);
            if max.value < least {
                findings.say(
                    max.span,
                    Code::OutOfRange,
                    format!(
                        "`max_age` is {}, but samples of `{}` become {} old by its period, latency and delay alone",
                        ms(max.value),
                        from.name.value,
                        ms(least)
                    ),
                    format!("write at least `{}`, or shorten `every` of `{}`", ms(least), from.name.value),
                );
            }
        }
    }
    document.contracts.iter().filter_map(|contract| path(document, wired, contract, findings)).collect()
}

fn start(every: Option<u64>, bound: &Marked<u64>, findings: &Findings) {
    match every {
        None => findings.say(
            bound.span,
            Code::TimerMissing,
            "`start_within` bounds the start of a timer, and this operator has none",
            "add `every: 10 ms`, or remove `start_within`",
        ),
        Some(every) if bound.value > every => findings.say(
            bound.span,
            Code::OutOfRange,
            format!("`start_within` is {}, longer than the period of {}", ms(bound.value), ms(every)),
            format!("write at most `{}`", ms(every)),
        ),
        Some(_) => {}
    }
}

fn path(
    document: &Document<'_>,
    wired: &[Wired],
    contract: &ParsedContract,
    findings: &Findings,
) -> Option<PathContract> {
    let from = output(document, wired, &contract.from, findings)?;
    let to = output(document, wired, &contract.to, findings)?;
    let name = |topic: &Marked<Topic>| format!("{}.{}", topic.value.operator.value, topic.value.port.value);
    let (first, last) = (name(&contract.from), name(&contract.to));
    let Some(quickest) = quickest(document, wired, from, to.0) else {
        findings.say(
            contract.path,
            Code::UnknownTopic,
            format!("no path leads from {first} to {last}"),
            "name topics of which the second is made from the first; `stillpoint graph` draws the edges",
        );
        return None;
    };
    let timers: u64 = quickest.timers.iter().map(|(_, every)| every).sum();
    let least = quickest.fixed.saturating_add((timers as f64 * contract.share) as u64);
    if contract.within.value < least {
        let mut parts: Vec<String> = quickest
            .timers
            .iter()
            .map(|(operator, every)| {
                format!("{} each {}", document.operators[*operator].name.value, ms(*every))
            })
            .collect();
        if quickest.fixed > 0 {
            parts.push(format!("declared delays and latencies of {}", ms(quickest.fixed)));
        }
        findings.say(
            contract.within.span,
            Code::OutOfRange,
            format!(
                "`within` is {}, but the quickest path from {first} to {last} waits up to {}: {}",
                ms(contract.within.value),
                ms(least),
                parts.join(", ")
            ),
            format!("write at least `{}`, or shorten `every` of these operators", ms(least)),
        );
        return None;
    }
    Some(PathContract {
        from: first,
        to: last,
        within: contract.within.value,
        share: contract.share,
        is_fault: contract.is_fault,
    })
}

/// A time as it is written in the file.
fn ms(ns: u64) -> String {
    format!("{} ms", ns as f64 * 1e-6)
}

/// What a path takes at least: fixed times, ns, and the timers at which samples wait.
#[derive(Clone, Default)]
struct Route {
    fixed: u64,
    timers: Vec<(usize, u64)>,
}

impl Route {
    fn longest(&self) -> u64 {
        self.timers.iter().fold(self.fixed, |sum, (_, every)| sum.saturating_add(*every))
    }
}

/// The path with the shortest delays, latencies and timers from an output to an operator.
fn quickest(
    document: &Document<'_>,
    wired: &[Wired],
    (operator, output): (usize, usize),
    to: usize,
) -> Option<Route> {
    let count = document.operators.len();
    let start = Route { fixed: document.operators[operator].latency, timers: Vec::new() };
    if operator == to {
        return Some(start);
    }
    let mut best: Vec<Option<Route>> = vec![None; count];
    let mut done = vec![false; count];
    best[operator] = Some(start);
    loop {
        let open = (0..count).filter(|at| !done[*at] && best[*at].is_some());
        let next = open.min_by_key(|at| best[*at].as_ref().map_or(u64::MAX, Route::longest))?;
        if next == to {
            return best[next].take();
        }
        done[next] = true;
        let Some(route) = best[next].clone() else { continue };
        for (consumer, node) in wired.iter().enumerate().filter(|(at, _)| !done[*at]) {
            for edge in node.inputs.iter().filter_map(|i| i.edge).filter(|e| e.operator == next) {
                // The path begins with this output; from there on any output of an operator leads on.
                if next == operator && edge.output != output {
                    continue;
                }
                let mut longer = route.clone();
                longer.fixed = longer
                    .fixed
                    .saturating_add(edge.delay)
                    .saturating_add(document.operators[consumer].latency);
                longer
                    .timers
                    .extend(document.operators[consumer].every.as_ref().map(|e| (consumer, e.value)));
                if best[consumer].as_ref().is_none_or(|b| longer.longest() < b.longest()) {
                    best[consumer] = Some(longer);
                }
            }
        }
    }
}
