//! Heads that nobody tells from other things: a search for the head may do without the checks of its identity only where
//! the file says so, and, if valves or a beam follow, only where the camera is a simulated rig.

use std::collections::BTreeSet;

use stillpoint_samples::{Datagram, Sample};

use super::confirm::real_camera;
use super::document::Document;
use super::faults::{Code, Findings};
use super::near::shown;
use super::port_frames::PortFrames;
use super::wiring::Wired;
use crate::params::CheckedParams;

/// The frame in whose axes the head is judged.
const COUCH: &str = "couch";

/// Checks it. `params` are the checked parameters of each operator, as far as they could be read.
pub fn check<'a>(
    document: &Document<'_>,
    wired: &[Wired],
    params: impl Iterator<Item = Option<&'a CheckedParams>>,
    frames: &PortFrames,
    findings: &Findings,
) {
    for (number, params) in params.enumerate() {
        let Some(resolved) = params.map(|p| &p.resolved) else { continue };
        // The kinds that look for a head have these parameters.
        let (body, region) = (&resolved["body"], &resolved["region"]["need"]);
        if !body.is_string() || !region.is_string() {
            continue;
        }
        let by_size = resolved["rule"] == "largest";
        let waived: Vec<&str> = [
            ("`rule: largest` takes the largest thing for the head", by_size),
            ("`body: waived` asks for no body next to the head", !by_size && *body == "waived"),
            ("`region: { need: waived }` takes a head anywhere", !by_size && *region == "waived"),
        ]
        .into_iter()
        .filter_map(|(what, holds)| holds.then_some(what))
        .collect();
        let (name, span) = (&document.operators[number].name.value, document.operators[number].name.span);
        let is_judged = !by_size && (*body == "required" || *region == "required");
        if is_judged && let Some(frame) = apart_from_couch(document, wired, frames, number) {
            findings.say(
                span,
                Code::FrameMissing,
                format!(
                    "{} cannot check that what it finds is the head: the frame {} is not connected to `{COUCH}`",
                    shown(name),
                    shown(frame)
                ),
                format!(
                    "place it in `frames` (`{frame}: {{ parent: {COUCH}, at: [...] }}`), or do without the checks: \
                     `body: waived, region: {{ need: waived }}`"
                ),
            );
        }
        let Some(what) = waived.first() else { continue };
        if let (Some(actor), Some(camera)) = (actor(wired, number), real_camera(document, wired, number)) {
            findings.say(
                span,
                Code::OutOfRange,
                format!(
                    "{what}, {} acts on it, and {}, which {} sees through, is not a simulated rig",
                    shown(&document.operators[actor].name.value),
                    shown(&document.operators[camera].name.value),
                    shown(name)
                ),
                "remove it: only a head that is distinguished from all else may hold valves and a beam",
            );
        }
    }
}

/// The frame of what an operator takes, where that is not connected to the couch.
fn apart_from_couch<'a>(
    document: &Document<'_>,
    wired: &[Wired],
    frames: &'a PortFrames,
    number: usize,
) -> Option<&'a str> {
    let edges = wired[number].inputs.iter().filter_map(|input| input.edge.as_ref());
    let mut named = edges.filter_map(|edge| frames.output(edge.operator, edge.output));
    named.find(|frame| document.frames.transform(COUCH, frame).is_none())
}

/// The first operator downstream that sends orders.
fn actor(wired: &[Wired], from: usize) -> Option<usize> {
    let (mut reached, mut grows) = (BTreeSet::from([from]), true);
    while grows {
        grows = false;
        for (number, operator) in wired.iter().enumerate() {
            let mut edges = operator.inputs.iter().filter_map(|input| input.edge.as_ref());
            if !reached.contains(&number) && edges.any(|edge| reached.contains(&edge.operator)) {
                grows |= reached.insert(number);
            }
        }
    }
    let orders = |number: &usize| {
        let outputs = wired[*number].stage.as_ref().map_or(&[][..], |stage| stage.kind.outputs);
        outputs.iter().any(|output| output.sample.name == Datagram::NAME)
    };
    reached.into_iter().find(orders)
}
