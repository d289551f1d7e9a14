//! The pass over a whole pipeline: parse, look up, check, and make the graph only where nothing is wrong.

use std::cell::RefCell;

use super::composed::compose_for;
use super::document;
use super::faults::{Code, Faults, Findings};
use super::includes::{FileText, Includes};
use super::machine::Machine;
use super::operators::ParsedOperator;
use super::source::{Sources, Span};
use super::tree::{Entry, Node, Value};
use super::variables::Replaced;
use super::wiring::Wired;
use super::{
    assemble, confirm, contracts, hosts, identity, links, order, port_frames, ros2, script_settings, sets,
    start, sync, variables, wiring, yaml,
};
use crate::graph::Graph;
use crate::operator::Files;
use crate::operator::{Feeder, Registry, Role, Stage, Timer};
use crate::params::{CheckedParams, ParamReader};

/// Where a file begins.
pub(super) const BEGINNING: Span = Span { source: 0, start: 0, end: 0, line: 1, column: 1 };

/// Reads a pipeline and checks all of it. `file_name` is what faults name; each of `sets` is an
/// `operator.param=value` that replaces what the file says; `files` answers for the files that parameters name.
pub fn check(
    text: &str,
    file_name: &str,
    sets: &[String],
    registry: &Registry,
    files: &dyn Files,
) -> Result<Graph, Faults> {
    // A session is replayed, and a run joined, wherever one is: what its processes asked of their machine is no fault.
    let purpose = Purpose::Restart;
    Request { machine: &Machine::default(), purpose, text, file_name, sets, registry, files }
        .checked()
        .map(|(graph, _)| graph)
}

/// What a pipeline is checked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    /// It is to run.
    Run,
    /// It is to run on the samples of a session.
    Rerun,
    /// It has run, or runs: what contradicts itself in it is a fact, which a replay shows.
    Restart,
}

/// As [`check`], for a pipeline that is to run on this machine: paths may name variables of the environment.
pub fn check_for(
    machine: &Machine,
    text: &str,
    file_name: &str,
    sets: &[String],
    registry: &Registry,
    files: &dyn Files,
) -> Result<Graph, Faults> {
    compose_for(machine, text, file_name, sets, registry, files).map(|composed| composed.graph)
}

/// What the texts of a pipeline were expanded to.
#[derive(Default)]
pub(super) struct Expansion {
    /// The files.
    pub texts: Vec<FileText>,
    /// The tree of all files, before any argument; none of a file that includes no other.
    pub tree: Option<Node>,
    /// The tree of all files with all arguments; none of a pipeline that has run already.
    pub whole: Option<Node>,
    /// What was replaced in paths.
    pub replaced: Replaced,
}

/// A pipeline that is to be checked, and for what.
pub(super) struct Request<'a> {
    pub machine: &'a Machine,
    pub purpose: Purpose,
    pub text: &'a str,
    pub file_name: &'a str,
    pub sets: &'a [String],
    pub registry: &'a Registry,
    pub files: &'a dyn Files,
}

impl Request<'_> {
    /// The graph, and what its texts were expanded to.
    pub fn checked(&self) -> Result<(Graph, Expansion), Faults> {
        let findings = Findings::default();
        let mut expansion =
            Expansion { texts: vec![FileText::own(self.file_name, self.text)], ..Default::default() };
        let graph = self.pass(&mut expansion, &findings);
        match graph {
            Some(graph) if findings.is_empty() => Ok((graph, expansion)),
            _ => {
                if findings.is_empty() {
                    let place = Default::default();
                    findings.say(
                        place,
                        Code::Syntax,
                        "the pipeline cannot be read",
                        "report it: no reason was found",
                    );
                }
                let files = expansion.texts.into_iter().map(|file| file.source).collect();
                Err(findings.into_faults(Sources::of_files(files, self.sets)))
            }
        }
    }

    fn pass(&self, expansion: &mut Expansion, findings: &Findings) -> Option<Graph> {
        let Self { machine, purpose, text, sets, registry, files, .. } = *self;
        let parsed = yaml::parse(text, 0, 0, findings);
        let Some(mut root) = parsed else {
            if findings.is_empty() {
                findings.say(
                    BEGINNING,
                    Code::WrongShape,
                    "the file is empty",
                    format!("begin with `stillpoint: {}`", document::VERSION),
                );
            }
            return None;
        };
        let (texts, replaced) = (&mut expansion.texts, &mut expansion.replaced);
        let mut includes = Includes::new(texts, files, machine.variables(), replaced, findings);
        includes.expand(&mut root);
        if !includes.is_whole {
            return None;
        }
        let texts = &expansion.texts;
        if texts.len() > 1 {
            expansion.tree = Some(root.clone());
        }
        let whole = sets::apply(&mut root, sets, texts.len(), findings);
        if purpose != Purpose::Restart || texts.len() > 1 {
            let replaced = &mut expansion.replaced;
            variables::expand(&mut root, texts, machine.variables(), replaced, registry, files, findings);
            expansion.whole = Some(root.clone());
        }
        let mut document = document::read(&root, findings)?;
        document.seed = whole.seed.unwrap_or(document.seed);
        let wired = wiring::connect(&document, registry, files, findings);
        let mut checked = Vec::new();
        for (parsed, wired) in document.operators.iter().zip(&wired) {
            let named = RefCell::new(Vec::new());
            let params =
                wired.stage.as_ref().and_then(|stage| params(parsed, stage, files, &named, findings));
            if let Some(stage) = &wired.stage {
                timer(parsed, stage, wired, findings);
            }
            checked.push((params, named.into_inner()));
        }
        if purpose == Purpose::Run {
            feeders(&document, &wired, &checked, findings);
        }
        let policies = sync::policies(&document, &wired, findings);
        links::check_taken(&document, &wired, findings);
        script_settings::check(&document, &wired, &checked, findings);
        confirm::check(&document, &wired, checked.iter().map(|(params, _)| params.as_ref()), findings);
        let links_stand = !document.links.is_some_and(|span| findings.any_within(span));
        let order = order::upstream_first(&document, &wired, links_stand, findings);
        let frames = port_frames::resolve(&document, &wired, findings);
        if machine.is_to_run() {
            let params = checked.iter().map(|(params, _)| params.as_ref());
            identity::check(&document, &wired, params, &frames, findings);
        }
        let processes = assemble::processes(&document, links_stand, findings);
        hosts::check(&document, &wired, &processes, links_stand, whole.host.as_ref(), findings);
        machine.check(&document, whole.host.as_ref().map(|h| h.value.as_str()), findings);
        let record = assemble::record(&document, &wired, findings);
        let contracts = contracts::check(&document, &wired, findings);
        let params = checked.iter().map(|(params, _)| params.as_ref());
        let ros2 = ros2::check(&document, &wired, params, &frames, findings);
        if !findings.is_empty() {
            return None;
        }
        let places = start::places(&document.operators);
        let mut graph =
            assemble::graph(document, wired, checked, policies, frames, order, processes, record, ros2)?;
        graph.contracts = contracts;
        if let Some(host) = whole.host {
            graph = graph.part(&host.value);
        }
        if purpose == Purpose::Run {
            start::check(&graph, &places, files, findings);
        }
        findings.is_empty().then_some(graph)
    }
}

fn params(
    parsed: &ParsedOperator<'_>,
    stage: &Stage,
    files: &dyn Files,
    named: &RefCell<Vec<String>>,
    findings: &Findings,
) -> Option<CheckedParams> {
    let entries: &[Entry] = match parsed.params {
        Some(node) => node.map("`params`", "a mapping from parameters to values", findings)?,
        None => &[],
    };
    // A missing parameter is reported where the operator is: it has no place of its own.
    let place = parsed.name.span;
    let params =
        (stage.read)(stage, &mut ParamReader::new(entries, stage.kind.name, place, findings, files, named))?;
    let every = parsed.every.as_ref().map(|every| every.value);
    let fits = |()| every.map_or(Ok(()), |every| (stage.validate_period)(&params, every));
    let opens = |()| (stage.check_files)(&params, files);
    if let Err(conflict) = (stage.validate)(&params).and_then(fits).and_then(opens) {
        let given =
            |name: &&str| entries.iter().find(|e| e.key.value == *name).map(|e| changed_last(&e.value));
        let place = conflict.params.iter().filter_map(given).rev().max_by_key(|p| p.source).unwrap_or(place);
        findings.say(place, Code::OutOfRange, conflict.reason, conflict.help);
    }
    Some(params)
}

/// Parameters that have to go together with those of the operator that feeds an input: the fault stands at the input.
fn feeders(
    document: &document::Document<'_>,
    wired: &[Wired],
    checked: &[(Option<CheckedParams>, Vec<String>)],
    findings: &Findings,
) {
    for (number, operator) in wired.iter().enumerate() {
        let (Some(stage), Some((Some(params), _))) = (&operator.stage, checked.get(number)) else { continue };
        for (input, connected) in operator.inputs.iter().enumerate() {
            let Some(edge) = connected.edge else { continue };
            let (Some(from), Some((Some(theirs), _))) =
                (&wired[edge.operator].stage, checked.get(edge.operator))
            else {
                continue;
            };
            let feeder = Feeder {
                operator: &document.operators[edge.operator].name.value,
                kind: from.kind.name,
                every: document.operators[edge.operator].every.as_ref().map(|every| every.value),
                params: &theirs.resolved,
            };
            if let Err(conflict) = (stage.validate_input)(params, input, &feeder) {
                findings.say(connected.span, Code::OutOfRange, conflict.reason, conflict.help);
            }
        }
    }
}

/// The place in a value that the last argument changed, else its own.
fn changed_last(node: &Node) -> Span {
    let inner: Vec<Span> = match &node.value {
        Value::List(items) => items.iter().map(changed_last).collect(),
        Value::Map(entries) => entries.iter().map(|e| changed_last(&e.value)).collect(),
        _ => Vec::new(),
    };
    inner.into_iter().filter(|p| p.source > node.span.source).max_by_key(|p| p.source).unwrap_or(node.span)
}

fn timer(parsed: &ParsedOperator<'_>, stage: &Stage, wired: &Wired, findings: &Findings) {
    let (name, kind) = (&parsed.name.value, stage.kind.name);
    // A missing required input is a fault of its own.
    let is_idle = !wired.is_fed() && stage.kind.inputs.iter().all(|i| !i.required);
    match (stage.kind.timer, parsed.has_every) {
        (Timer::Required, None) => findings.say(
            parsed.name.span,
            Code::TimerMissing,
            format!("`{name}` ({kind}) runs by a timer, but `every` does not say how often"),
            "add `every: 10 ms` with its period",
        ),
        (Timer::No, Some(span)) => findings.say(
            span,
            Code::TimerForbidden,
            format!("`{name}` ({kind}) runs when samples come and has no timer"),
            "remove `every`",
        ),
        (timer, None) if stage.kind.role == Role::Operator && is_idle => {
            let help = match timer {
                Timer::No => "connect an input, or remove the operator",
                _ => "connect an input, or add `every: 10 ms`",
            };
            findings.say(
                parsed.name.span,
                Code::NeverActivated,
                format!("nothing ever activates `{name}` ({kind}): none of its inputs is connected"),
                help,
            );
        }
        _ => {}
    }
}
