//! The summary at the end of a run.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use stillpoint_operator::{Policy, Registry};
use stillpoint_pipeline::graph::Graph;
use stillpoint_pipeline::live::status::OperatorFigures;
use stillpoint_pipeline::live::{Fault, RunReport};
use stillpoint_recorder::{Session, SessionError, session_parts};

use crate::columns::{Columns, Side};
use crate::exit::Failure;
use stillpoint_report::accuracy::{self, Accuracy};
use stillpoint_report::contracts::{self, ContractFigures};
use stillpoint_report::facts::gaps_of;
use stillpoint_report::hold::{Held, Hold};
use stillpoint_report::refused::{self, Refused};
use stillpoint_report::trace::{Journals, as_run};
use stillpoint_report::unanswered::{Answers, Verdict};
use stillpoint_report::uncaptured::{self, Uncaptured};
use stillpoint_samples::Entry;

/// Number of failures that are shown.
const MOST_FAULTS: usize = 10;

/// Operators that are named if a machine is too slow, and the share of a core from which on they are.
const MOST_WORK: usize = 3;
const MUCH_WORK: f64 = 0.05;

/// The part of ticks, or of samples on an input, that may be missed before the machine counts as too slow.
const SLOW: f64 = 0.05;

/// What was seen of a run while it ran. It exists without a session, too.
#[derive(Default)]
pub struct Observed {
    /// How the head was held; none if the run could not be observed.
    pub held: Option<Held>,
    /// What operators answered.
    pub answers: Answers,
    /// The journals by operator, of a run with contracts that nothing records.
    pub entries: Option<Vec<Vec<Entry>>>,
}

/// The figures of a run and of its session.
pub struct Summary<'a> {
    report: &'a RunReport,
    session: Option<&'a Path>,
    held: Option<Held>,
    accuracy: Option<Accuracy>,
    /// Number of samples in the session, with journals and with the parts whose recorder died.
    samples: u64,
    /// Why the session is not complete.
    gaps: Vec<String>,
    refused: Vec<Refused>,
    uncaptured: Vec<Uncaptured>,
    verdict: Verdict,
    contracts: Vec<ContractFigures>,
    too_slow: Vec<String>,
    /// What operators leave out of their files, by operator.
    remarks: BTreeMap<String, Vec<String>>,
    /// Whether the session has code that a replay does not run unasked.
    has_code: bool,
}

impl<'a> Summary<'a> {
    /// The summary of a run of this graph, with its session as it was opened. `observed` comes from the run itself, so it
    /// exists without a session, too.
    pub fn new(
        report: &'a RunReport,
        graph: &Graph,
        registry: &Registry,
        is_live: bool,
        session: Option<&'a Path>,
        opened: Option<&Result<Session, SessionError>>,
        observed: Observed,
    ) -> Self {
        let readable = opened.and_then(|o| o.as_ref().ok());
        let mut held = readable.and_then(|session| Hold::of_session(graph, session));
        let mut answers =
            readable.map_or_else(Answers::default, |session| Answers::of_session(graph, session));
        answers.add_missing(observed.answers);
        let contracts = match (readable, &observed.entries) {
            (Some(session), _) => judged(session, graph),
            (None, Some(entries)) => {
                let ran = graph.clone().live();
                contracts::of(&ran, &Journals::of_run(&ran, entries))
            }
            (None, None) => Vec::new(),
        };
        match (&mut held, observed.held) {
            (Some(held), Some(observed)) => held.add_missing(observed),
            (None, observed) => held = observed,
            (Some(_), None) => {}
        }
        Self {
            report,
            session,
            verdict: answers.verdict(graph, &report.operators),
            contracts,
            held,
            accuracy: readable.and_then(accuracy::of_session),
            samples: readable.map_or_else(|| report.recorded.iter().map(|r| r.samples).sum(), samples),
            gaps: match opened {
                None => Vec::new(),
                Some(Ok(session)) => gaps_of(session, registry),
                Some(Err(e)) => vec![e.to_string()],
            },
            refused: readable.map_or_else(Vec::new, |session| refused::of_session(session, graph, report)),
            uncaptured: readable.map_or_else(Vec::new, |session| uncaptured::of_session(session, graph)),
            too_slow: if is_live { too_slow(report, graph) } else { Vec::new() },
            remarks: BTreeMap::new(),
            has_code: graph.operators.iter().any(|node| node.stage.described.is_some()),
        }
    }

    /// The same with what operators leave out of their files.
    #[must_use]
    pub fn with_remarks(self, remarks: &BTreeMap<String, Vec<String>>) -> Self {
        Self { remarks: remarks.clone(), ..self }
    }

    /// Whether a replay of the session has all that it needs, or none was recorded.
    pub fn is_complete(&self) -> bool {
        self.gaps.is_empty()
    }

    /// Whether an operator that should answer never did.
    pub fn is_unanswered(&self) -> bool {
        !self.verdict.unanswered.is_empty() || !self.uncaptured.is_empty()
    }

    /// Whether a contract is broken that the pipeline says is a failure.
    pub fn breaks_contract(&self) -> bool {
        self.contracts.iter().any(|c| c.is_broken && c.is_fault)
    }

    /// The report as JSON, with the path of the session, how the head was held, the accuracy, the frames without a result,
    /// and the trackers without a reference.
    pub fn to_json(&self) -> Result<Value, Failure> {
        let mut value = serde_json::to_value(self.report).map_err(Failure::failed)?;
        value["too_slow"] = json!(self.too_slow);
        value["what_helps"] =
            if self.too_slow.is_empty() { Value::Null } else { what_helps(&self.report.operators).into() };
        value["remarks"] = json!(self.remarks);
        value["held"] = json!(self.held);
        value["found"] = json!(self.verdict.found);
        value["unanswered"] = json!(self.verdict.unanswered);
        value["contracts"] = json!(self.contracts);
        if let Some(session) = self.session {
            value["session"] = session.display().to_string().into();
            value["session_bytes"] = size_of(session).into();
            value["samples"] = self.samples.into();
            value["parts"] = parts(session).len().into();
            value["complete"] = self.gaps.is_empty().into();
            value["gaps"] = json!(self.gaps);
            value["accuracy"] = json!(self.accuracy);
            value["refused"] = json!(self.refused);
            value["uncaptured"] = json!(self.uncaptured);
        }
        Ok(value)
    }

    /// Prints it for people: what was found and held, then time, losses and the session. The tables of operators and edges
    /// are printed where they are asked for, or something went wrong.
    pub fn print(&self, is_verbose: bool) {
        let report = self.report;
        outln!("{}: {:.1} s of session time", report.pipeline, report.seconds);
        if let Some(reason) = &report.ended_early {
            outln!("ended early: {reason}");
        }
        for id in &report.swept {
            outln!("removed the leftovers of the dead run {id}");
        }
        for unanswered in &self.verdict.unanswered {
            outln!("NO ANSWER: {unanswered}");
        }
        for (operator, remarks) in &self.remarks {
            remarks.iter().for_each(|remark| outln!("{operator}: {remark}"));
        }
        for uncaptured in &self.uncaptured {
            outln!("{uncaptured}");
        }
        for found in &self.verdict.found {
            outln!("{found}");
        }
        if let Some(held) = &self.held {
            out!("{held}");
        }
        if let Some(accuracy) = &self.accuracy {
            outln!("{accuracy}");
        }
        if self.too_slow.is_empty() {
            outln!("time: no timer and no input missed more than {:.0} %", SLOW * 100.0);
        } else {
            outln!("THIS MACHINE IS TOO SLOW for this pipeline, or was busy with other work:");
        }
        for slow in &self.too_slow {
            outln!("  {slow}");
        }
        if !self.too_slow.is_empty() {
            outln!("{}", what_helps(&report.operators));
        }
        for contract in &self.contracts {
            outln!("{}{contract}", if contract.is_broken { "CONTRACT BROKEN: " } else { "contract " });
        }
        print_losses(report);
        if is_verbose || self.is_wrong() {
            print_operators(report);
            print_faults(report);
            print_ledger(report);
        }
        if let Some(session) = self.session {
            self.print_session(session);
        }
    }

    /// Whether the tables say more about what went wrong.
    fn is_wrong(&self) -> bool {
        let report = self.report;
        let is_stopped = report.ended_early.as_deref().is_none_or(|reason| reason == "stopped");
        let is_well = report.balanced && report.faults.is_empty() && report.recording_failed.is_none();
        !(is_well && is_stopped && self.gaps.is_empty() && self.too_slow.is_empty())
    }

    fn print_session(&self, session: &Path) {
        let report = self.report;
        let lost: u64 = report.recorded.iter().flat_map(|r| r.lost.values()).sum();
        let size = size_of(session) as f64 / 1e6;
        let count = parts(session).len();
        if let Some(reason) = &report.recording_failed {
            outln!("THE RECORDING FAILED: {reason}");
        }
        outln!(
            "session {}: {size:.1} MB{}, {count} part{}, {} samples{}",
            session.display(),
            // A session of no length has no rate.
            if report.seconds >= 1e-3 {
                format!(" ({:.1} MB/s)", size / report.seconds)
            } else {
                String::new()
            },
            if count == 1 { "" } else { "s" },
            self.samples,
            if lost > 0 { format!(", {lost} NOT KEPT") } else { String::new() }
        );
        match self.gaps.split_first() {
            None => outln!("complete: the session holds everything that a replay needs"),
            Some((first, [])) => outln!("not complete: {first}"),
            Some((first, more)) => {
                outln!("not complete: {first}; `stillpoint info` lists {} more gaps", more.len());
            }
        }
        let trust = if self.has_code { "--trust " } else { "" };
        outln!(
            "to replay: stillpoint {trust}replay {0}    (cargo run --release -- {trust}replay {0})",
            session.display()
        );
    }
}

/// The timers that missed ticks, and the inputs on which some samples did not cause the activation that they should cause.
fn too_slow(report: &RunReport, graph: &Graph) -> Vec<String> {
    let mut found = Vec::new();
    let mut judge = |count: u64, of: u64, what: String| {
        let part = count as f64 / of.max(1) as f64;
        if part > SLOW {
            found.push(format!("{what} {count} of {of} ({:.0} %)", part * 100.0));
        }
    };
    for o in &report.operators {
        judge(o.missed, o.ticks + o.missed, format!("{} missed ticks of its timer:", o.operator));
    }
    for node in &graph.operators {
        let is_latest = |policy: Policy| matches!(policy, Policy::Latest);
        // The newest sample is a cause where there is no other.
        let causes = node.every.is_none() && node.inputs.iter().all(|i| is_latest(i.policy));
        for (input, port) in node.inputs.iter().zip(node.stage.kind.inputs) {
            let consumer = format!("{}.{}", node.name, port.name);
            let Some(line) = report.ledger.iter().find(|line| line.consumer == consumer) else { continue };
            let skipped = match (is_latest(input.policy), causes) {
                (true, true) => line.overwritten + line.passed,
                (true, false) => 0,
                (false, _) => line.overwritten,
            };
            judge(skipped, line.sent, format!("{consumer} skipped samples of {}:", line.topic));
        }
    }
    found
}

/// What became of the samples that no operator received, in a line.
fn print_losses(report: &RunReport) {
    let sum =
        |of: fn(&stillpoint_pipeline::ledger::LedgerLine) -> u64| report.ledger.iter().map(of).sum::<u64>();
    let losses = [
        (sum(|l| l.overwritten), "overwritten"),
        (sum(|l| l.pool_exhausted), "without memory"),
        (sum(|l| l.down), "sent to a process that was down"),
        (sum(|l| l.unheard), "unheard"),
        (sum(|l| l.refused), "refused"),
        (sum(|l| l.lost), "lost on a link"),
    ];
    let message: Vec<String> = losses
        .iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, what)| format!("{count} {what}"))
        .collect();
    let message = if message.is_empty() { "none".to_owned() } else { message.join(", ") };
    outln!(
        "losses: {message}; {}",
        if report.balanced { "the ledger balances" } else { "THE LEDGER DOES NOT BALANCE" }
    );
}

/// What helps against a machine that is too slow: the operators that take the most of a core, and what to do.
fn what_helps(operators: &[OperatorFigures]) -> String {
    let share = |o: &OperatorFigures| Some(o.rate_hz * o.step_ms[0] * 1e-3).filter(|s| s.is_finite());
    let mut shares: Vec<(f64, &str)> =
        operators.iter().filter_map(|o| Some((share(o)?, o.operator.as_str()))).collect();
    shares.sort_by(|a, b| b.0.total_cmp(&a.0));
    let most: Vec<String> = shares
        .iter()
        .take(MOST_WORK)
        .filter(|(share, _)| *share >= MUCH_WORK)
        .map(|(share, name)| format!("{name} takes {:.0} % of a core", share * 100.0))
        .collect();
    let work = match most.as_slice() {
        [] => "no operator takes much of a core, so other work does".to_owned(),
        some => format!(
            "{}: give them less work (camera rate, size of images), or cores (`core:`)",
            some.join(", ")
        ),
    };
    format!(
        "what helps: {work}; fewer processes (`processes:`); `--clock simulated`, which takes the time that it needs. \
         `stillpoint doctor` measures the machine, `stillpoint trace` the paths"
    )
}

/// The contracts of a graph against the journals of a session.
pub fn judged(session: &Session, graph: &Graph) -> Vec<ContractFigures> {
    let ran = as_run(graph, session);
    contracts::of(&ran, &Journals::of_session(session, Some(&ran)))
}

fn print_operators(report: &RunReport) {
    outln!();
    outln!(
        "{:<16} {:>8} {:>8} {:>16} {:>16}  failures",
        "operator",
        "done",
        "Hz",
        "step ms p50 p99",
        "age ms p50 p99"
    );
    for o in &report.operators {
        let pair =
            |p: [f64; 2]| if p[0].is_finite() { format!("{:.2} {:.2}", p[0], p[1]) } else { "-".to_string() };
        let mut failures = Vec::new();
        let mut say = |n: u64, what: &str| {
            if n > 0 {
                failures.push(format!("{n} {what}"));
            }
        };
        say(o.errors, "errors");
        say(o.panics, "panics");
        say(u64::from(o.incarnations.saturating_sub(1)), "restarts");
        say(o.missed, "ticks missed");
        outln!(
            "{:<16} {:>8} {:>8.1} {:>16} {:>16}  {}",
            o.operator,
            o.activations,
            o.rate_hz,
            pair(o.step_ms),
            pair(o.age_ms),
            failures.join(", ")
        );
    }
}

/// Prints each failure once, with its count.
fn print_faults(report: &RunReport) {
    let mut counts: Vec<(&Fault, u64)> = Vec::new();
    for fault in &report.faults {
        match counts.iter_mut().find(|(seen, _)| *seen == fault) {
            Some((_, count)) => *count += 1,
            None => counts.push((fault, 1)),
        }
    }
    if !counts.is_empty() {
        outln!();
    }
    for (fault, count) in counts.iter().take(MOST_FAULTS) {
        let often = if *count > 1 { format!(" ({count} times)") } else { String::new() };
        outln!("failed: {}: {}{often}", fault.operator, fault.reason);
    }
    if counts.len() > MOST_FAULTS {
        outln!("and {} other failures; --json lists all of them", counts.len() - MOST_FAULTS);
    }
}

fn print_ledger(report: &RunReport) {
    let right = [
        "sent",
        "received",
        "passed",
        "overwritten",
        "no memory",
        "down",
        "left",
        "unheard",
        "refused",
        "lost",
        "UNEXPLAINED",
    ];
    let head = [(Side::Left, "ledger: topic -> input")];
    let mut table = Columns::new(head.into_iter().chain(right.map(|name| (Side::Right, name))));
    let mut silent = 0;
    for line in &report.ledger {
        let counts = [
            line.sent,
            line.received,
            line.passed,
            line.overwritten,
            line.pool_exhausted,
            line.down,
            line.left,
            line.unheard,
            line.refused,
            line.lost,
        ];
        if counts.iter().all(|count| *count == 0) && line.balances() {
            silent += 1;
            continue;
        }
        let unexplained = if line.balances() { "0".to_owned() } else { line.unexplained.to_string() };
        let counts = counts.map(|count| count.to_string());
        let name = format!("{} -> {}", line.topic, line.consumer);
        table.row(std::iter::once(name).chain(counts).chain([unexplained]));
    }
    let none = table.fold_zeros();
    out!("\n{table}");
    if silent > 0 {
        outln!("and {silent} inputs to which nothing was sent");
    }
    if !none.is_empty() {
        outln!("columns of zeros: {}", none.join(", "));
    }
}

/// Samples of a session.
fn samples(session: &Session) -> u64 {
    (0..session.topics().len()).map(|topic| session.numbers(topic).count() as u64).sum()
}

/// The files of a session.
fn parts(session: &Path) -> Vec<PathBuf> {
    session_parts(session).unwrap_or_default()
}

/// Bytes of a session's files.
fn size_of(session: &Path) -> u64 {
    parts(session).iter().filter_map(|p| p.metadata().ok()).map(|m| m.len()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_helps_names_the_operators_that_take_the_most_of_a_core() {
        let operator = |name: &str, rate_hz: f64, step: f64| OperatorFigures {
            operator: name.into(),
            activations: 100,
            rate_hz,
            errors: 0,
            panics: 0,
            incarnations: 1,
            sent: 100,
            sent_by_output: vec![100],
            lost: 0,
            ticks: 0,
            missed: 0,
            step_ms: [step, step],
            age_ms: [f64::NAN; 2],
        };
        let all = [
            operator("law", 100.0, 0.1),
            operator("face", 10.0, 60.0),
            operator("idle", 0.0, f64::NAN),
            operator("head", 10.0, 8.0),
        ];
        let message = what_helps(&all);
        assert!(
            message.starts_with("what helps: face takes 60 % of a core, head takes 8 % of a core: give"),
            "{message}"
        );
        assert!(
            what_helps(&all[..1]).starts_with("what helps: no operator takes much of a core"),
            "{message}"
        );
    }
}
