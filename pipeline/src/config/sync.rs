//! How inputs are consumed: the config's word, else the kind's, and which inputs go in step.

use super::document::Document;
use super::faults::{Code, Findings};
use super::inputs::ParsedPolicy;
use super::near::{nearest, shown};
use super::wiring::Wired;
use crate::operator::{Policy, Stage};

/// Policy of an input, and for `Sync` the first input of its set.
pub type Consumption = (Policy, Option<usize>);

/// Policies of all inputs, by operator and port.
pub fn policies(document: &Document<'_>, wired: &[Wired], findings: &Findings) -> Vec<Vec<Consumption>> {
    wired
        .iter()
        .enumerate()
        .map(|(number, wired)| match &wired.stage {
            Some(stage) => of_operator(document, number, wired, stage, findings),
            None => Vec::new(),
        })
        .collect()
}

fn of_operator(
    document: &Document<'_>,
    number: usize,
    wired: &Wired,
    stage: &Stage,
    findings: &Findings,
) -> Vec<Consumption> {
    let operator = &document.operators[number];
    let ports = stage.kind.inputs;
    let parsed = |port: usize| wired.inputs[port].parsed.and_then(|i| operator.inputs.get(i));
    let message = |port: usize| parsed(port).and_then(|i| i.policy.as_ref());
    let mut found: Vec<Option<Consumption>> = vec![None; ports.len()];
    for (port, found) in found.iter_mut().enumerate() {
        match message(port).map(|p| &p.value) {
            Some(ParsedPolicy::Latest) => *found = Some((Policy::Latest, None)),
            Some(ParsedPolicy::Queue(length)) => *found = Some((Policy::Queue(*length), None)),
            _ => {}
        }
    }
    for port in 0..ports.len() {
        let Some(ParsedPolicy::Sync { with, within }) = message(port).map(|p| &p.value) else { continue };
        let mut set = vec![port];
        for partner in with {
            match ports.iter().position(|p| p.name == partner.value) {
                Some(other) if parsed(other).is_some() => set.push(other),
                Some(_) => findings.say(
                    partner.span,
                    Code::Policy,
                    format!("{} is not connected, so nothing can be in step with it", shown(&partner.value)),
                    "connect it, or leave it out",
                ),
                None => {
                    let names: Vec<&str> = ports.iter().map(|p| p.name).collect();
                    let near = nearest(&partner.value, names.iter().copied());
                    findings.say(
                        partner.span,
                        Code::UnknownPort,
                        format!("{} has no input {}", stage.kind.name, shown(&partner.value)),
                        near.map_or_else(
                            || super::near::listed(names.iter().copied(), "inputs"),
                            |n| format!("did you mean `{n}`?"),
                        ),
                    );
                }
            }
        }
        set.sort_unstable();
        set.dedup();
        let consumption = (Policy::Sync { within: *within }, set.first().copied());
        for member in &set {
            match &found[*member] {
                Some(other) if *other != consumption => {
                    let span = message(port).map_or(operator.name.span, |p| p.span);
                    findings.say(
                        span,
                        Code::Policy,
                        format!("`{}` is already consumed in another way", ports[*member].name),
                        "say `sync` at one input of the set only, and no other policy at its partners",
                    );
                }
                _ => found[*member] = Some(consumption),
            }
        }
    }
    by_kind(found, stage, wired)
}

/// Fills in the kind's policies. Inputs that the kind puts in step form one set.
fn by_kind(found: Vec<Option<Consumption>>, stage: &Stage, wired: &Wired) -> Vec<Consumption> {
    let ports = stage.kind.inputs;
    let is_in_step = |port: usize| {
        found[port].is_none()
            && wired.inputs[port].edge.is_some()
            && matches!(ports[port].policy, Policy::Sync { .. })
    };
    let leader = (0..ports.len()).find(|p| is_in_step(*p));
    (0..ports.len())
        .map(|port| match (found[port], ports[port].policy) {
            (Some(message), _) => message,
            (None, Policy::Sync { within }) => {
                let within = match leader.map(|l| ports[l].policy) {
                    Some(Policy::Sync { within }) => within,
                    _ => within,
                };
                (Policy::Sync { within }, leader.or(Some(port)))
            }
            (None, policy) => (policy, None),
        })
        .collect()
}
