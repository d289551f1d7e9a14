//! What crosses from one host to another: every such edge is a link or goes between hosts of the section `hosts`, and the
//! host that is asked for is there.

use stillpoint_samples::{Datagram, Sample};

use super::document::Document;
use super::faults::{Code, Findings};
use super::near::{shown, suggestion};
use super::source::Marked;
use super::wiring::Wired;
use crate::graph::{Edge, ProcessNode};
use crate::hosts::MAIN;

/// Checks it. Numbers of operators are their places in the file.
pub fn check(
    document: &Document<'_>,
    wired: &[Wired],
    processes: &[ProcessNode],
    links_stand: bool,
    chosen: Option<&Marked<String>>,
    findings: &Findings,
) {
    let mut homes = vec![MAIN; document.operators.len()];
    for process in processes {
        for operator in &process.operators {
            homes[*operator] = &process.host;
        }
    }
    // A link carries datagrams alone.
    let may_be_link = |edge: Edge| {
        let sender = wired[edge.operator].stage.as_ref();
        let is_datagram = sender.is_some_and(|s| *s.kind.outputs[edge.output].sample == *Datagram::KIND);
        is_datagram && document.hosts.is_empty()
    };
    for (number, (operator, wired)) in document.operators.iter().zip(wired).enumerate() {
        // Links that are at fault are said already.
        if operator.link.is_some() || !links_stand {
            continue;
        }
        for input in &wired.inputs {
            let Some(edge) = input.edge.filter(|e| homes[e.operator] != homes[number]) else { continue };
            let producer = &document.operators[edge.operator];
            let Some(from) = input.parsed.and_then(|p| operator.inputs[p].from.as_ref()) else { continue };
            let (there, here) = (homes[edge.operator], homes[number]);
            let name = &operator.name.value;
            let (message, help) = match producer.link {
                Some(_) => (
                    format!("`{name}` runs on the host `{here}`, but the far end of this link on `{there}`"),
                    format!("name `{}` in a process of the host `{here}`", producer.name.value),
                ),
                None if may_be_link(edge) => (
                    format!(
                        "`{name}` runs on the host `{here}`, but this comes from `{there}` and is not a link"
                    ),
                    format!(
                        "add `{}.{}` to `links`, or list both hosts under `hosts`",
                        from.value.operator.value, from.value.port.value
                    ),
                ),
                None => (
                    format!(
                        "`{name}` runs on the host `{here}`, but this comes from `{there}`, and `hosts` does not \
                         list both"
                    ),
                    format!("list `{here}` and `{there}` under `hosts`, with their endpoints"),
                ),
            };
            findings.say(from.span, Code::Host, message, help);
        }
    }
    for host in &document.hosts {
        if !homes.contains(&host.node.name.as_str()) {
            findings.say(
                host.span,
                Code::Host,
                format!("nothing of this pipeline runs on the host {}", shown(&host.node.name)),
                "give a process this `host`, or remove it",
            );
        }
    }
    if let Some(host) = chosen
        && !homes.contains(&host.value.as_str())
    {
        let mut names = homes;
        names.sort_unstable();
        names.dedup();
        findings.say(
            host.span,
            Code::Host,
            format!("nothing of this pipeline runs on the host {}", shown(&host.value)),
            suggestion(&host.value, names.iter().copied(), "hosts", findings),
        );
    }
}
