//! The frame of each port: named by the operator's `frame`, passed on from an input, or joined by a transform.

use super::document::Document;
use super::faults::{Code, Findings};
use super::near::{shown, suggestion};
use super::source::Span;
use super::wiring::Wired;
use crate::operator::FrameRule;

/// The frame that usually has no parent.
const COUCH: &str = "couch";

/// Frames of all outputs, by operator and port.
pub struct PortFrames {
    outputs: Vec<Vec<Option<String>>>,
}

impl PortFrames {
    /// The frame of an output.
    pub fn output(&self, operator: usize, port: usize) -> Option<&str> {
        self.outputs.get(operator)?.get(port)?.as_deref()
    }
}

/// Finds the frame of each output and checks that inputs fit together.
pub fn resolve(document: &Document<'_>, wired: &[Wired], findings: &Findings) -> PortFrames {
    for (number, wired) in wired.iter().enumerate() {
        keys(document, number, wired, findings);
    }
    let mut frames = PortFrames {
        outputs: wired
            .iter()
            .map(|w| vec![None; w.stage.as_ref().map_or(0, |s| s.kind.outputs.len())])
            .collect(),
    };
    for operator in 0..wired.len() {
        for output in 0..frames.outputs[operator].len() {
            follow(document, wired, &mut frames, operator, output);
        }
    }
    for operator in 0..wired.len() {
        fit(document, wired, &frames, operator, findings);
    }
    frames
}

/// The `frame` key of an operator: there where it must be, and known.
fn keys(document: &Document<'_>, number: usize, wired: &Wired, findings: &Findings) {
    let operator = &document.operators[number];
    if let Some(frame) = &operator.frame
        && !document.frames.knows(&frame.value)
    {
        let placed = &document.frames.placed;
        let mut names: Vec<&str> = placed.iter().flat_map(|(n, f)| [n.as_str(), f.parent.as_str()]).collect();
        names.sort_unstable();
        names.dedup();
        findings.say(
            frame.span,
            Code::UnknownFrame,
            format!("there is no frame {}", shown(&frame.value)),
            match names.is_empty() {
                // It is known as soon as another one is placed in it.
                true if frame.value == COUCH => format!(
                    "place a frame in it: `frames: {{ camera: {{ parent: {COUCH}, at: [0 mm, 0 mm, 500 mm] }} }}`"
                ),
                true => format!(
                    "add it: `frames: {{ {}: {{ parent: {COUCH}, at: [0 mm, 0 mm, 500 mm] }} }}`",
                    frame.value
                ),
                false => suggestion(&frame.value, names.iter().copied(), "frames", findings),
            },
        );
    }
    let Some(stage) = &wired.stage else { return };
    let rules = || stage.kind.outputs.iter().map(|o| o.frame);
    let name = &operator.name.value;
    if rules().any(|r| r == FrameRule::Key) && operator.has_frame.is_none() {
        findings.say(
            operator.name.span,
            Code::FrameMissing,
            format!("`{name}` ({}) must say in which frame its samples are", stage.kind.name),
            "add `frame:` with a name from `frames`",
        );
    }
    if let Some(span) = operator.has_frame
        && !rules().any(|r| matches!(r, FrameRule::Key | FrameRule::KeyOr(_)))
    {
        findings.say(
            span,
            Code::FrameNotTaken,
            format!("`{name}` ({}) takes the frame of its inputs and has none of its own", stage.kind.name),
            "remove `frame`",
        );
    }
}

/// What an output's frame comes from.
enum Origin {
    Frame(Option<String>),
    Output(usize, usize),
}

fn origin(document: &Document<'_>, wired: &[Wired], operator: usize, output: usize) -> Origin {
    let Some(stage) = &wired[operator].stage else { return Origin::Frame(None) };
    let key = || document.operators[operator].frame.as_ref().map(|f| f.value.clone());
    let passed = |input: &str| {
        let port = stage.kind.inputs.iter().position(|i| i.name == input);
        match port.and_then(|p| wired[operator].inputs[p].edge) {
            Some(edge) => Origin::Output(edge.operator, edge.output),
            None => Origin::Frame(None),
        }
    };
    match stage.kind.outputs[output].frame {
        FrameRule::None => Origin::Frame(None),
        FrameRule::Key => Origin::Frame(key()),
        FrameRule::KeyOr(input) => key().map_or_else(|| passed(input), |k| Origin::Frame(Some(k))),
        FrameRule::SameAs(input) => passed(input),
        FrameRule::Named(name) => Origin::Frame(Some(name.to_owned())),
    }
}

/// Goes upstream until a frame is named; all outputs on the way have it. Feedback without a named frame has none.
fn follow(document: &Document<'_>, wired: &[Wired], frames: &mut PortFrames, operator: usize, output: usize) {
    let mut path = std::collections::BTreeSet::new();
    let (mut at, mut frame) = ((operator, output), None);
    while path.insert(at) {
        if let Some(known) = frames.output(at.0, at.1) {
            frame = Some(known.to_owned());
            break;
        }
        match origin(document, wired, at.0, at.1) {
            Origin::Frame(named) => {
                frame = named;
                break;
            }
            Origin::Output(o, p) => at = (o, p),
        }
    }
    for (o, p) in path {
        frames.outputs[o][p].clone_from(&frame);
    }
}

/// Whether the inputs of an operator are in frames that it can bring together.
fn fit(document: &Document<'_>, wired: &[Wired], frames: &PortFrames, operator: usize, findings: &Findings) {
    let Some(stage) = &wired[operator].stage else { return };
    let inputs = stage.kind.inputs.iter().zip(&wired[operator].inputs);
    let framed: Vec<(&str, &str, Span)> = inputs
        .filter_map(|(port, input)| {
            let edge = input.edge?;
            Some((port.name, frames.output(edge.operator, edge.output)?, input.span))
        })
        .collect();
    let key = document.operators[operator].frame.as_ref();
    // A frame of its own means that the operator transforms; without one, numbers of two frames would be mixed.
    let own: Vec<&str> = stage
        .kind
        .outputs
        .iter()
        .filter_map(|o| match o.frame {
            FrameRule::Key | FrameRule::KeyOr(_) => key.map(|k| k.value.as_str()),
            FrameRule::Named(name) => Some(name),
            _ => None,
        })
        .collect();
    let name = &document.operators[operator].name.value;
    if let Some(first) = own.first() {
        let is_known = key.is_none_or(|k| document.frames.knows(&k.value));
        for (port, frame, span) in framed {
            let joins = |own: &&str| *own == frame || document.frames.transform(own, frame).is_some();
            if is_known && !own.iter().any(joins) {
                findings.say(
                    span,
                    Code::FrameMismatch,
                    format!("`{port}` is in the frame `{frame}`, which nothing joins to `{first}`, the frame of `{name}`"),
                    format!("place `{frame}` or `{first}` in `frames` so that both hang on one root"),
                );
            }
        }
        return;
    }
    let passed = stage.kind.outputs.iter().find_map(|o| match o.frame {
        FrameRule::KeyOr(input) | FrameRule::SameAs(input) => framed.iter().find(|f| f.0 == input),
        _ => None,
    });
    let Some((lead, expected, _)) = passed.or(framed.first()) else { return };
    for (port, frame, span) in &framed {
        if frame != expected {
            findings.say(
                *span,
                Code::FrameMismatch,
                format!("`{port}` is in the frame `{frame}`, but `{lead}` is in `{expected}`, and `{name}` does not transform"),
                format!("connect a topic in `{expected}`, or transform one of the two before it"),
            );
        }
    }
}
