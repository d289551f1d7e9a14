//! The contracts of a pipeline against the times of its journals: what was kept, what was broken, which operator is to blame,
//! and what would help.

use std::collections::BTreeMap;
use std::fmt::{Display, Formatter};

use serde::Serialize;
use stillpoint_pipeline::graph::{Graph, PathContract};
use stillpoint_samples::{Cause, RefKind};

use crate::trace::{Blame, Journals, Judged, PoseRole, passages_between};
use crate::wiring::is_activation;

/// Names of those to blame that are printed.
const BLAMED: usize = 3;

/// A contract with what the journals say about it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ContractFigures {
    /// The contract, as people write it.
    pub contract: String,
    /// The bound.
    pub bound_ms: f64,
    /// Samples or activations that were judged.
    pub judged: u64,
    /// Those that were beyond the bound, or never arrived.
    pub broken: u64,
    /// The share that kept it; none if nothing was judged.
    pub retained: Option<f64>,
    /// The share that has to keep it.
    pub needed: f64,
    /// The longest.
    pub worst_ms: Option<f64>,
    /// Which operator with which part of its time was to blame, and how often; the most frequent first.
    pub blame: Vec<Blame>,
    /// Whether the contract is broken.
    pub is_broken: bool,
    /// Whether a broken contract is a failure of the run.
    pub is_fault: bool,
    /// What would help.
    pub advice: Vec<String>,
}

impl Display for ContractFigures {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: ", self.contract)?;
        let Some(retained) = self.retained else { return write!(f, "not judged, no sample came to its end") };
        write!(f, "kept by {:.1} % of {}", retained * 100.0, self.judged)?;
        write!(f, " (needed: {} %)", self.needed * 100.0)?;
        if let Some(worst) = self.worst_ms {
            write!(f, ", worst {worst:.1} ms")?;
        }
        if self.broken > 0 && !self.blame.is_empty() {
            let sentence: Vec<String> = self.blame.iter().take(BLAMED).map(Blame::text).collect();
            write!(f, "; to blame: {}", sentence.join(", "))?;
        }
        Ok(())
    }
}

/// What the journals say of the contracts of a graph.
pub fn of(graph: &Graph, journals: &Journals<'_>) -> Vec<ContractFigures> {
    let mut found: Vec<ContractFigures> =
        graph.contracts.iter().filter_map(|contract| path(graph, journals, contract)).collect();
    for node in &graph.operators {
        let Some(number) = journals.operators.iter().position(|o| o.stage.name == node.name) else {
            continue;
        };
        for (port, input) in node.inputs.iter().enumerate() {
            if let Some(limit) = input.max_age {
                let name = node.stage.kind.inputs.get(port).map_or("", |i| i.name);
                found.push(age(journals, number, port, name, limit.max));
            }
        }
        if let Some(bound) = node.start_within {
            found.push(start(journals, number, bound));
        }
    }
    found
}

/// Whether a graph has bounds of time.
pub fn is_any(graph: &Graph) -> bool {
    let has = |o: &stillpoint_pipeline::graph::OperatorNode| {
        o.start_within.is_some() || o.inputs.iter().any(|i| i.max_age.is_some())
    };
    !graph.contracts.is_empty() || graph.operators.iter().any(has)
}

fn ms(ns: u64) -> f64 {
    ns as f64 * 1e-6
}

/// What was judged of a contract.
#[derive(Default)]
struct Account {
    judged: u64,
    broken: u64,
    worst: Option<u64>,
    blame: BTreeMap<(String, PoseRole), usize>,
}

impl Account {
    fn blame(&mut self, operator: &str, part: PoseRole) {
        *self.blame.entry((operator.to_owned(), part)).or_default() += 1;
    }

    fn figures(self, contract: String, bound: u64, needed: f64) -> ContractFigures {
        let retained = (self.judged > 0).then(|| 1.0 - self.broken as f64 / self.judged as f64);
        let mut blame: Vec<Blame> = self
            .blame
            .into_iter()
            .map(|((operator, part), samples)| Blame { operator, part, samples })
            .collect();
        blame.sort_by_key(|b| std::cmp::Reverse(b.samples));
        ContractFigures {
            contract,
            bound_ms: ms(bound),
            judged: self.judged,
            broken: self.broken,
            is_broken: retained.is_some_and(|retained| retained < needed),
            retained,
            needed,
            worst_ms: self.worst.map(ms),
            blame,
            is_fault: false,
            advice: Vec::new(),
        }
    }
}

/// Samples of a path. One that an operator never took is broken; one of which nothing was made, such as an image without a
/// face, is not judged.
fn path(graph: &Graph, journals: &Journals<'_>, contract: &PathContract) -> Option<ContractFigures> {
    let mut account = Account::default();
    for judged in passages_between(journals, &contract.from, &contract.to)? {
        match judged {
            Judged::Arrived { total, operator, part } => {
                account.judged += 1;
                account.worst = account.worst.max(Some(total));
                if total > contract.within {
                    account.broken += 1;
                    account.blame(&operator, part);
                }
            }
            Judged::Lost { operator } => {
                account.judged += 1;
                account.broken += 1;
                account.blame(&operator, PoseRole::Busy);
            }
        }
    }
    let text = format!("{} -> {} within {} ms", contract.from, contract.to, ms(contract.within));
    let mut figures = account.figures(text, contract.within, contract.share);
    figures.is_fault = contract.is_fault;
    if figures.broken > 0 {
        figures.advice = advice(graph, &figures.blame);
    }
    Some(figures)
}

/// Ages of the samples that activations took or held.
fn age(journals: &Journals<'_>, number: usize, port: usize, input: &str, max: u64) -> ContractFigures {
    let node = &journals.operators[number];
    let mut account = Account::default();
    let producer = journals.producer(number, port);
    for entry in node.entries.iter().filter(|e| is_activation(e)) {
        let mut refs = entry.refs_of(RefKind::Fresh).map(|r| (r, true));
        let mut held = entry.refs_of(RefKind::Held).map(|r| (r, false));
        let found = refs.find(|(r, _)| r.port as usize == port && r.count > 0);
        let Some((r, is_new)) = found.or_else(|| held.find(|(r, _)| r.port as usize == port && r.count > 0))
        else {
            continue;
        };
        let Some((from, output)) = producer else { continue };
        let of = &journals.operators[from];
        let Some(maker) = of.maker(output, r.incarnation, r.first) else { continue };
        let age = entry.header.stamp.saturating_sub(of.entries[maker].header.origin);
        account.judged += 1;
        account.worst = account.worst.max(Some(age));
        if age > max {
            account.broken += 1;
            // A new sample was late when it came; an old one is held because none came after it.
            account.blame(&of.stage.name, if is_new { PoseRole::Step } else { PoseRole::Hold });
        }
    }
    let text = format!("{}.{input} at most {} ms old", node.stage.name, ms(max));
    account.figures(text, max, 1.0)
}

/// Starts of a timer.
fn start(journals: &Journals<'_>, number: usize, bound: u64) -> ContractFigures {
    let node = &journals.operators[number];
    let mut account = Account::default();
    for entry in node.entries.iter().filter(|e| e.cause() == Some(Cause::Timer)) {
        let (due, begun) = (entry.body.nominal, entry.header.stamp);
        let late = begun.saturating_sub(due);
        account.judged += 1;
        account.worst = account.worst.max(Some(late));
        if late > bound {
            account.broken += 1;
            let busy = journals.busy(number, due, begun);
            account.blame(&node.stage.name, if 2 * busy > late { PoseRole::Busy } else { PoseRole::Wake });
        }
    }
    let text = format!("{} starts within {} ms of its tick", node.stage.name, ms(bound));
    account.figures(text, bound, 1.0)
}

/// What would help against what is to blame.
fn advice(graph: &Graph, blame: &[Blame]) -> Vec<String> {
    let mut found = Vec::new();
    for Blame { operator, part, .. } in blame.iter().take(BLAMED) {
        let node = graph.operators.iter().find(|o| o.name == *operator);
        let process = node.and_then(|n| graph.processes.get(n.process));
        let sentence = match part {
            PoseRole::Tick => node.and_then(|n| n.every).map(|every| {
                format!("{operator} waits for its timer: shorten `every` (now {} ms)", ms(every))
            }),
            PoseRole::Step => Some(format!(
                "{operator} steps longer than usual: lower its work (camera rate, size of images), or give its process a core \
                 (`core:`)"
            )),
            PoseRole::Busy => process.map(|p| {
                if p.operators.len() > 1 {
                    format!("process {} is busy: take {operator} out of the group, or lower the rate upstream", p.name)
                } else {
                    format!("{operator} is busy with the samples before: lower the rate upstream")
                }
            }),
            PoseRole::Wake => process.map(|p| {
                format!("process {} gets a core too late: `priority: fifo 50` or `core:`; `stillpoint doctor` measures it", p.name)
            }),
            PoseRole::Hold => Some(format!("{operator} sends nothing for a while: look at its inputs")),
            PoseRole::Delay => Some(format!("the declared delay into {operator} is too long for the bound")),
            PoseRole::Acquisition => Some(format!("{operator} hands its samples on late: look at the camera")),
        };
        found.extend(sentence);
    }
    found
}
