//! The section `hosts`: who exchanges samples over the network, and where each is reached.
//!
//! An edge between two hosts of the section stands for an operator of its own on the host that takes the samples, named
//! after topic and host (`planner_plan_bedside`). The bridges of the two hosts carry its samples.

use std::path::PathBuf;

use super::faults::{Code, Findings};
use super::fields::check_name;
use super::inputs::{ParsedInput, Topic, topic_at};
use super::near::shown;
use super::operators::ParsedOperator;
use super::processes::{ParsedProcess, RESTART};
use super::source::{Marked, Span};
use super::tree::{Entry, Keys, Node, Value};
use crate::graph::{HostNode, HostTls, LateInput, Priority, Wire};
use crate::hosts::{MAIN, edge_name, endpoint_fault};
use crate::{far_end, link};

/// Keys of a host.
pub const KEYS: &[&str] = &["listen", "connect", "router", "tls", "takes"];
/// Keys of a host's certificate.
pub const TLS_KEYS: &[&str] = &["certificate", "key", "authority"];

/// A host as it was written.
pub struct ParsedHost {
    /// Its endpoints.
    pub node: HostNode,
    /// Place of its name.
    pub span: Span,
    /// Topics of other hosts that it takes although no operator of it does.
    takes: Vec<Marked<Topic>>,
}

/// Reads the section.
pub fn read(node: &Node, findings: &Findings) -> Vec<ParsedHost> {
    let expected = "a mapping from hosts to { listen: tcp/ADDRESS:PORT } or { connect: tcp/ADDRESS:PORT }";
    let entries = node.map("`hosts`", expected, findings).unwrap_or_default();
    let hosts: Vec<ParsedHost> = entries.iter().filter_map(|e| host(e, findings)).collect();
    let is_alone = |h: &ParsedHost| h.node.connect.is_empty() && h.node.router.is_empty();
    if !hosts.is_empty() && hosts.iter().all(is_alone) && !findings.any_within(node.span) {
        findings.say(
            node.span,
            Code::MissingKey,
            "no host connects to another, so nothing can pass between them",
            "give one host `listen`, and the others `connect` with an endpoint of it",
        );
    }
    hosts
}

fn host(entry: &Entry, findings: &Findings) -> Option<ParsedHost> {
    check_name(&entry.key, "a host", findings);
    let name = shown(&entry.key.value);
    let entries = entry.value.map(&name, "{ listen: tcp/10.0.0.7:7447 }", findings)?;
    let keys = Keys::of(entries, KEYS, "a host", findings);
    let tls = keys.get("tls").map(|e| tls(e, findings));
    let of = |key| keys.get(key).map(|e| endpoints(e, tls.is_some(), findings)).unwrap_or_default();
    let node = HostNode {
        name: entry.key.value.clone(),
        listen: of("listen"),
        connect: of("connect"),
        router: of("router"),
        tls: tls.flatten(),
    };
    if let Some(router) = keys.get("router")
        && (keys.get("listen").is_some() || keys.get("connect").is_some())
    {
        findings.say(
            router.key.span,
            Code::WrongShape,
            format!("{name} reaches the others through a router, so it neither listens nor connects to them"),
            "remove `router`, or the other endpoints",
        );
    } else if KEYS[..3].iter().all(|key| keys.get(key).is_none()) {
        findings.say(
            entry.key.span,
            Code::MissingKey,
            format!("{name} neither listens nor connects"),
            "write `listen: tcp/ADDRESS:PORT` or `connect: tcp/ADDRESS:PORT`",
        );
    }
    let takes = keys.get("takes").and_then(|e| e.value.list("`takes`", "a list of topics", findings));
    let topic =
        |node: &Node| topic_at(node.scalar("a topic", "`operator.port`", findings)?, node.span, findings);
    let takes = takes.unwrap_or_default().iter().filter_map(topic).collect();
    Some(ParsedHost { node, span: entry.key.span, takes })
}

/// One endpoint, or a list of them.
fn endpoints(entry: &Entry, has_tls: bool, findings: &Findings) -> Vec<String> {
    let what = shown(&entry.key.value);
    let nodes: Vec<&Node> = match &entry.value.value {
        Value::List(items) => items.iter().collect(),
        _ => vec![&entry.value],
    };
    nodes.into_iter().filter_map(|node| endpoint(node, &what, has_tls, findings)).collect()
}

/// The certificate of a host.
fn tls(entry: &Entry, findings: &Findings) -> Option<HostTls> {
    let expected = "{ certificate: FILE, key: FILE, authority: FILE }";
    let keys = Keys::of(entry.value.map("`tls`", expected, findings)?, TLS_KEYS, "a certificate", findings);
    let file = |key: &str| {
        let Some(entry) = keys.get(key) else {
            findings.say(
                entry.key.span,
                Code::MissingKey,
                format!("`tls` has no `{key}`"),
                "name the three files that `stillpoint pki certificate` makes",
            );
            return None;
        };
        entry.value.scalar(key, "the name of a file", findings).map(PathBuf::from)
    };
    let (certificate, key, authority) = (file("certificate"), file("key"), file("authority"));
    Some(HostTls { certificate: certificate?, key: key?, authority: authority? })
}

fn endpoint(node: &Node, what: &str, has_tls: bool, findings: &Findings) -> Option<String> {
    let text = node.scalar(what, "an endpoint", findings)?;
    match endpoint_fault(text, has_tls) {
        None => Some(text.to_owned()),
        Some((message, help)) => {
            findings.say(node.span, Code::WrongShape, message, help);
            None
        }
    }
}

/// The host of each operator, and the process that names it.
fn homes(operators: &[ParsedOperator<'_>], processes: &[ParsedProcess]) -> Vec<(String, Option<usize>)> {
    let home = |operator: &ParsedOperator<'_>| {
        let names = |p: &ParsedProcess| p.operators.iter().any(|o| o.value == operator.name.value);
        match processes.iter().position(names) {
            Some(process) => (processes[process].host.value.clone(), Some(process)),
            None => (MAIN.to_owned(), None),
        }
    };
    operators.iter().map(home).collect()
}

/// Adds an operator for every topic that goes from one host of the section to another, in the process of the first
/// consumer, and connects the consumers on that host to it.
pub fn connect(
    hosts: &[ParsedHost],
    operators: &mut Vec<ParsedOperator<'_>>,
    processes: &mut Vec<ParsedProcess>,
    findings: &Findings,
) {
    let homes = homes(operators, processes);
    let number = |host: &str| hosts.iter().position(|h| h.node.name == host);
    let mut added: Vec<ParsedOperator<'_>> = Vec::new();
    for consumer in 0..operators.len() {
        // The far end of a link is on the host of the operators that take its samples.
        if operators[consumer].link.is_some() {
            continue;
        }
        let (here, process) = &homes[consumer];
        for input in 0..operators[consumer].inputs.len() {
            let Some(from) = operators[consumer].inputs[input].from.clone() else { continue };
            let producer = operators.iter().position(|o| o.name.value == from.value.operator.value);
            let Some(producer) = producer else { continue };
            let (there, _) = &homes[producer];
            let (Some(host), Some(_)) = (number(here), number(there)) else { continue };
            if here == there || operators[producer].link.is_some() {
                continue;
            }
            let name = edge_name(&from.value.operator.value, &from.value.port.value, here);
            if let Some(taken) = &mut operators[consumer].inputs[input].from {
                taken.value.operator.value.clone_from(&name);
                taken.value.port.value = far_end::PORT.to_owned();
            }
            if added.iter().all(|o| o.name.value != name) {
                if let Some(process) = process {
                    let member = Marked::new(name.clone(), processes[*process].name.span);
                    processes[*process].operators.push(member);
                }
                added.push(far_operator(name, from, host));
            }
        }
    }
    for (host, parsed) in hosts.iter().enumerate() {
        for topic in &parsed.takes {
            let name = edge_name(&topic.value.operator.value, &topic.value.port.value, &parsed.node.name);
            if added.iter().any(|o| o.name.value == name) {
                continue;
            }
            let producer = operators.iter().position(|o| o.name.value == topic.value.operator.value);
            if let Some(there) = producer.map(|producer| &homes[producer].0)
                && (*there == parsed.node.name || number(there).is_none())
            {
                findings.say(
                    topic.span,
                    Code::Host,
                    format!(
                        "`{}` runs on the host `{there}`, so nothing of it comes to `{}` over the network",
                        topic.value.operator.value, parsed.node.name
                    ),
                    "name a topic of another host of `hosts`, or remove it",
                );
                continue;
            }
            processes.push(own_process(&name, &parsed.node.name, topic.span));
            added.push(far_operator(name, topic.clone(), host));
        }
    }
    for far in &added {
        if let Some(other) = operators.iter().find(|o| o.name.value == far.name.value) {
            findings.say(
                other.name.span,
                Code::DuplicateName,
                format!("`{}` is also the name of what takes a topic of another host", far.name.value),
                "give the operator another name",
            );
        }
    }
    operators.extend(added);
}

/// The process of an operator whose samples no operator of its host takes.
fn own_process(operator: &str, host: &str, span: Span) -> ParsedProcess {
    ParsedProcess {
        name: Marked::new(operator.to_owned(), span),
        operators: vec![Marked::new(operator.to_owned(), span)],
        restart: RESTART,
        core: None,
        priority: Priority::Normal,
        outlives: 0,
        host: Marked::new(host.to_owned(), span),
    }
}

/// The operator that takes the samples of an edge on the host of this number.
fn far_operator<'t>(name: String, from: Marked<Topic>, host: usize) -> ParsedOperator<'t> {
    let span = from.span;
    let input = ParsedInput {
        name: Marked::new(far_end::PORT.to_owned(), span),
        from: Some(from),
        policy: None,
        max_age: None,
        otherwise: LateInput::Count,
        delay: 0,
    };
    ParsedOperator {
        inputs: vec![input],
        every: Some(Marked::new(link::EVERY, span)),
        has_every: Some(span),
        link: Some(Wire::Host(host)),
        ..ParsedOperator::named(Marked::new(name, span))
    }
}
