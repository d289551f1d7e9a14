//! References and plans that nobody looks at: a script may confirm or accept one, or `confirm: waived` do without, only
//! where the camera is a simulated rig.

use std::collections::BTreeSet;

use super::document::Document;
use super::faults::{Code, Findings};
use super::near::shown;
use super::wiring::Wired;
use crate::console::{ConsoleParams, KIND_NAME, ScriptCommand};
use crate::params::CheckedParams;

/// Kinds whose names begin so simulate the camera and the head.
const RIGS: &str = "rig.";
/// Port of the console's verb, and the parameter that may waive it.
const CONFIRM: &str = "confirm";
/// What a person has to look at: the console's port, the word of a script, and the fault of a script that says it.
const LOOKED_AT: [(&str, ScriptCommand, &str); 2] = [
    (CONFIRM, ScriptCommand::Confirm, "a script confirms its reference"),
    ("accept", ScriptCommand::Accept, "a script accepts its plan"),
];

/// Checks it. `params` are the checked parameters of each operator, as far as they could be read.
pub fn check<'a>(
    document: &Document<'_>,
    wired: &[Wired],
    params: impl Iterator<Item = Option<&'a CheckedParams>>,
    findings: &Findings,
) {
    let numbers = document.numbers();
    let params: Vec<Option<&CheckedParams>> = params.collect();
    let says = |console: usize, command: ScriptCommand| {
        let params = params.get(console).copied().flatten();
        let params = params.and_then(|p| p.value.downcast_ref::<ConsoleParams>());
        params.is_some_and(|p| p.script.iter().any(|line| line.say == command))
    };
    for (number, params) in params.iter().enumerate() {
        let console = params.and_then(|p| p.value.downcast_ref::<ConsoleParams>());
        let lacks = |input: &usize| wired[number].inputs.get(*input).is_none_or(|i| i.parsed.is_none());
        if let Some(input) = console.and_then(|params| params.unanswered().find(lacks)) {
            let name = wired[number].stage.as_ref().map_or("", |stage| stage.kind.inputs[input].name);
            findings.say(
                document.operators[number].name.span,
                Code::MissingInput,
                format!("`repeat` of the script needs the input `{name}`: it states whether a command was accepted"),
                "connect it with a delay, such as `actuation: { from: valves.state, delay: 20 ms }`",
            );
        }
    }
    for (number, parsed) in document.operators.iter().enumerate() {
        let console = parsed.inputs.iter().find_map(|input| {
            let topic = &input.from.as_ref()?.value;
            let console = *numbers.get(topic.operator.value.as_str())?;
            let (_, command, what) = LOOKED_AT.iter().find(|(port, ..)| *port == topic.port.value)?;
            says(console, *command).then_some((console, *what))
        });
        let is_waived = params
            .get(number)
            .copied()
            .flatten()
            .is_some_and(|p| p.resolved.get(CONFIRM).is_some_and(|value| value == "waived"));
        let (span, what) = match console {
            Some((console, what)) => (document.operators[console].name.span, what),
            None if is_waived => (parsed.name.span, "`confirm: waived` takes its reference unseen"),
            None => continue,
        };
        if let Some(camera) = real_camera(document, wired, number) {
            findings.say(
                span,
                Code::OutOfRange,
                format!(
                    "{} sees through {}, which is not a simulated rig, and {what}: no person has looked at it",
                    shown(&parsed.name.value),
                    shown(&document.operators[camera].name.value)
                ),
                "let a person look: `stillpoint send console.confirm` or `console.accept`",
            );
        }
    }
}

/// The first source upstream of an operator that is neither a rig nor a console.
pub(super) fn real_camera(document: &Document<'_>, wired: &[Wired], from: usize) -> Option<usize> {
    let (mut seen, mut next) = (BTreeSet::from([from]), vec![from]);
    let mut found = BTreeSet::new();
    while let Some(number) = next.pop() {
        let kind = document.operators[number].kind.as_ref().map_or("", |kind| kind.value.as_str());
        if kind.starts_with(RIGS) || kind == KIND_NAME {
            continue;
        }
        let edges: Vec<usize> =
            wired[number].inputs.iter().filter_map(|i| Some(i.edge.as_ref()?.operator)).collect();
        if edges.is_empty() && number != from {
            found.insert(number);
        }
        next.extend(edges.into_iter().filter(|upstream| seen.insert(*upstream)));
    }
    found.first().copied()
}
