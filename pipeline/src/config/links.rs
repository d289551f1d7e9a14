//! The section `links`: edges whose samples leave the machine's memory.
//!
//! A link stands for an operator of its own at the far end, named after the topic (`valves_datagram`), and everybody who
//! takes the topic takes it from there. In a live run the producer's process sends each sample as a UDP datagram, for
//! which the far end listens; anywhere else the link is an edge with a delay.

use std::net::SocketAddr;

use super::document::Document;
use super::faults::{Code, Findings};
use super::fields::{missing, time};
use super::inputs::{ParsedInput, ParsedPolicy, Topic, topic_at};
use super::near::shown;
use super::operators::ParsedOperator;
use super::source::Marked;
use super::tree::{Entry, Keys, Node};
use super::wiring::Wired;
use crate::graph::{LateInput, Wire};
use crate::link;

/// Keys of a link.
pub const KEYS: &[&str] = &["udp", "delay"];
/// Name of input and output of the far end.
const PORT: &str = "datagram";

/// Reads the section, adds the far ends to the operators and connects those who take the topics to them.
pub fn read<'t>(node: &'t Node, operators: &mut Vec<ParsedOperator<'t>>, findings: &Findings) {
    let expected = "a mapping from topics to { udp: address:port }";
    let mut taken: Vec<SocketAddr> = Vec::new();
    for entry in node.map("`links`", expected, findings).unwrap_or_default() {
        if let Some(far) = far_operator(entry, operators, findings) {
            if let Some(Wire::Udp(address)) = far.link {
                if taken.iter().any(|other| clash(other, &address)) {
                    findings.say(
                        entry.value.span,
                        Code::DuplicateName,
                        "another link has this address and port: only one of them could be opened",
                        "give each link a port of its own",
                    );
                }
                taken.push(address);
            }
            operators.push(far);
        }
    }
}

/// Whether two links cannot be opened at the same time: one port, and addresses of which one is the other or stands for
/// all.
fn clash(a: &SocketAddr, b: &SocketAddr) -> bool {
    a.port() == b.port() && (a.ip() == b.ip() || a.ip().is_unspecified() || b.ip().is_unspecified())
}

fn far_operator<'t>(
    entry: &'t Entry,
    operators: &mut [ParsedOperator<'t>],
    findings: &Findings,
) -> Option<ParsedOperator<'t>> {
    let topic = topic_at(&entry.key.value, entry.key.span, findings)?;
    let what = shown(&entry.key.value);
    let entries = entry.value.map(&what, "{ udp: 127.0.0.1:5005, delay: 2 ms }", findings)?;
    if let Some(tcp) = entries.iter().find(|e| e.key.value == "tcp") {
        findings.say(
            tcp.key.span,
            Code::UnknownKey,
            "a link carries datagrams, and has no key `tcp`",
            "list both hosts under `hosts`: samples of any type pass between them, without a link",
        );
        return None;
    }
    let keys = Keys::of(entries, KEYS, "a link", findings);
    let wire = wire(&keys, entry, findings);
    let delay = keys.get("delay").and_then(|e| time(e, findings)).map_or(0, |t| t.value);
    let name = format!("{}_{}", topic.value.operator.value, topic.value.port.value);
    if let Some(other) = operators.iter().find(|o| o.name.value == name) {
        findings.say(
            other.name.span,
            Code::DuplicateName,
            format!("`{name}` is also the name of the far end of the link {what}"),
            "give the operator another name",
        );
    }
    let same =
        |t: &Topic| t.operator.value == topic.value.operator.value && t.port.value == topic.value.port.value;
    for input in operators.iter_mut().flat_map(|o| &mut o.inputs) {
        if let Some(from) = input.from.as_mut().filter(|from| same(&from.value)) {
            from.value.operator.value.clone_from(&name);
            from.value.port.value = PORT.to_owned();
        }
    }
    let span = entry.key.span;
    let input = ParsedInput {
        name: Marked::new(PORT.to_owned(), span),
        from: Some(topic),
        policy: Some(Marked::new(ParsedPolicy::Queue(link::WAITING), span)),
        max_age: None,
        otherwise: LateInput::Count,
        delay,
    };
    Some(ParsedOperator {
        kind: Some(Marked::new(link::KIND_NAME.to_owned(), span)),
        inputs: vec![input],
        every: Some(Marked::new(link::EVERY, span)),
        has_every: Some(span),
        link: wire,
        ..ParsedOperator::named(Marked::new(name, span))
    })
}

/// Finds links that lead nowhere, once the inputs are connected.
pub fn check_taken(document: &Document<'_>, wired: &[Wired], findings: &Findings) {
    for (far, parsed) in document.operators.iter().enumerate() {
        // What a host takes from another, it may take for its session alone.
        if matches!(parsed.link, None | Some(Wire::Host(_))) {
            continue;
        }
        // A topic that is not there is a fault of its own.
        let Some(span) = wired[far].inputs.iter().find(|i| i.edge.is_some()).map(|i| i.span) else {
            continue;
        };
        let takes =
            |i: &ParsedInput| i.from.as_ref().is_some_and(|t| t.value.operator.value == parsed.name.value);
        if !document.operators.iter().flat_map(|o| &o.inputs).any(takes) {
            let Some(Topic { operator, port }) = parsed.inputs[0].from.as_ref().map(|t| &t.value) else {
                continue;
            };
            findings.say(
                span,
                Code::UnknownTopic,
                format!("no operator takes `{}.{}`, so the link leads nowhere", operator.value, port.value),
                "connect an input to it, or remove the link",
            );
        }
    }
}

fn wire(keys: &Keys<'_>, entry: &Entry, findings: &Findings) -> Option<Wire> {
    let Some(udp) = keys.get("udp") else {
        missing("a link", "udp", "127.0.0.1:5005", entry.key.span, findings);
        return None;
    };
    address(udp, findings).map(Wire::Udp)
}

fn address(entry: &Entry, findings: &Findings) -> Option<SocketAddr> {
    let node = &entry.value;
    let text = node.scalar(&shown(&entry.key.value), "an address and a port", findings)?;
    let address = text.parse::<SocketAddr>().ok().filter(|a| a.port() != 0);
    if address.is_none() {
        findings.say(
            node.span,
            Code::WrongShape,
            format!("{} is not an address with a port", shown(text)),
            "write the numbers of both, for example `127.0.0.1:5005`",
        );
    }
    address
}
