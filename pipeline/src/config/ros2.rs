//! What goes to ROS 2 and comes from it: each publication is of a topic that has such a message, and a pipeline that takes
//! topics of ROS 2 says where its router is.

use stillpoint_recorder::RosMessage;

use super::document::Document;
use super::faults::{Code, Findings};
use super::inputs::Topic;
use super::near::{nearest, shown};
use super::port_frames::PortFrames;
use super::ros2_section::{ParsedPublication, ParsedRos2};
use super::wiring::Wired;
use crate::graph::{Publication, Ros2Node};
use crate::operator::ros2::Subscription;
use crate::params::CheckedParams;

/// Checks the section and what the operators take.
pub fn check<'p>(
    document: &Document<'_>,
    wired: &[Wired],
    params: impl Iterator<Item = Option<&'p CheckedParams>>,
    frames: &PortFrames,
    findings: &Findings,
) -> Option<Ros2Node> {
    let takes: Vec<Vec<Subscription>> = wired
        .iter()
        .zip(params)
        .map(|(wired, params)| match (&wired.stage, params) {
            (Some(stage), Some(params)) => (stage.subscriptions)(params),
            _ => Vec::new(),
        })
        .collect();
    let Some(section) = &document.ros2 else {
        for (operator, takes) in document.operators.iter().zip(&takes) {
            if let Some(first) = takes.first() {
                findings.say(
                    operator.name.span,
                    Code::MissingKey,
                    format!(
                        "`{}` takes {} of ROS 2, and the file does not say where its router is",
                        operator.name.value, first.topic
                    ),
                    "add `ros2: { connect: tcp/127.0.0.1:7447 }`",
                );
            }
        }
        return None;
    };
    if section.publish.is_empty() && takes.iter().all(Vec::is_empty) && !findings.any_within(section.whole) {
        findings.say(
            section.span,
            Code::MissingKey,
            "nothing of this pipeline goes to ROS 2 or comes from it",
            "add `publish: { head.pose: { topic: /head_pose } }`, or an operator `ingest.ros2`, or remove `ros2`",
        );
    }
    let mut publications = Vec::new();
    for parsed in &section.publish {
        publications.extend(publication(document, wired, frames, parsed, findings).unwrap_or_default());
    }
    no_topic_twice(section, &publications, &takes, document, findings);
    Some(Ros2Node { connect: section.connect.clone(), domain: section.domain, publications })
}

/// What is published of a topic.
fn publication(
    document: &Document<'_>,
    wired: &[Wired],
    frames: &PortFrames,
    parsed: &ParsedPublication,
    findings: &Findings,
) -> Option<Vec<Publication>> {
    let (operator, port) = super::assemble::output(document, wired, &parsed.of, findings)?;
    let Topic { operator: from, port: output } = &parsed.of.value;
    let of = format!("{}.{}", from.value, output.value);
    let kind = wired[operator].stage.as_ref()?.kind.outputs[port].sample;
    let messages = RosMessage::of(kind);
    if messages.is_empty() {
        findings.say(
            parsed.of.span,
            Code::TypeMismatch,
            format!("`{of}` has samples of {}, for which ROS 2 has no message", kind.name),
            "name a topic of poses, clouds, depth images or grey images",
        );
        return None;
    }
    let publish = |topic: String, message| Publication {
        of: of.clone(),
        topic,
        message,
        child: parsed.frame.as_ref().map_or_else(String::new, |f| f.value.clone()),
    };
    let mut publications = Vec::new();
    if let Some(topic) = &parsed.topic {
        let message = message(messages, parsed, kind.name, findings)?;
        publications.push(publish(topic.value.as_str().to_owned(), message));
        if messages.contains(&RosMessage::CameraInfo) {
            match topic.value.sibling("camera_info") {
                Ok(sibling) => {
                    publications.push(publish(sibling.as_str().to_owned(), RosMessage::CameraInfo));
                }
                Err(reason) => findings.say(
                    topic.span,
                    Code::BadName,
                    format!("there can be no `camera_info` next to {}: {reason}", topic.value.as_str()),
                    "shorten the name",
                ),
            }
        }
    }
    if let Some(frame) = &parsed.frame {
        if !messages.contains(&RosMessage::TfMessage) {
            findings.say(
                frame.span,
                Code::TypeMismatch,
                format!("`{of}` has samples of {}, which place no frame", kind.name),
                "remove `tf`, or name a topic of poses",
            );
        } else if frames.output(operator, port).is_none() {
            findings.say(
                frame.span,
                Code::FrameMissing,
                format!("the poses of `{of}` are in no frame, so they place none"),
                "remove `tf`",
            );
        } else if document.frames.knows(&frame.value) {
            findings.say(
                frame.span,
                Code::DuplicateName,
                format!("{} is a frame of the pipeline already", shown(&frame.value)),
                "give what the pose places another name",
            );
        } else {
            publications.push(publish("/tf".to_owned(), RosMessage::TfMessage));
        }
    }
    Some(publications)
}

/// The message that `type` names, else the usual one.
fn message(
    messages: &[RosMessage],
    parsed: &ParsedPublication,
    kind: &str,
    findings: &Findings,
) -> Option<RosMessage> {
    let Some(asked) = &parsed.message else { return messages.first().copied() };
    // What stands beside another message, or on /tf, is not asked for.
    let offered = messages.iter().filter(|m| !matches!(m, RosMessage::CameraInfo | RosMessage::TfMessage));
    if let Some(message) = RosMessage::from_name(&asked.value)
        && offered.clone().any(|m| *m == message)
    {
        return Some(message);
    }
    let names: Vec<&str> = offered.map(|m| m.short_name()).collect();
    let help = match nearest(&asked.value, names.iter().copied()) {
        Some(near) => format!("did you mean `{near}`?"),
        None => format!("types: {}", names.join(", ")),
    };
    findings.say(
        asked.span,
        Code::UnknownChoice,
        format!("{} does not carry a {kind}", shown(&asked.value)),
        help,
    );
    None
}

/// One sender a topic: no two publications of one topic, and none of a topic that the pipeline takes.
fn no_topic_twice(
    section: &ParsedRos2,
    publications: &[Publication],
    takes: &[Vec<Subscription>],
    document: &Document<'_>,
    findings: &Findings,
) {
    for parsed in &section.publish {
        let Some(topic) = &parsed.topic else { continue };
        let name = topic.value.as_str();
        if publications.iter().filter(|p| p.topic == name).count() > 1 {
            findings.say(
                topic.span,
                Code::DuplicateName,
                format!("{name} is published twice"),
                "give each topic a name of its own; a depth image takes `camera_info` next to its own name, too",
            );
        }
        if let Some(taker) = takes.iter().position(|takes| takes.iter().any(|t| t.topic == name)) {
            findings.say(
                topic.span,
                Code::DuplicateName,
                format!("`{}` takes {name}, which this publishes", document.operators[taker].name.value),
                "connect the operator to the topic of the pipeline, or publish under another name",
            );
        }
    }
    let mut frames: Vec<&super::source::Marked<String>> =
        section.publish.iter().filter_map(|p| p.frame.as_ref()).collect();
    frames.sort_by(|a, b| (&a.value, a.span).cmp(&(&b.value, b.span)));
    for pair in frames.windows(2).filter(|pair| pair[0].value == pair[1].value) {
        findings.say(
            pair[1].span,
            Code::DuplicateName,
            format!("another pose places the frame {}", shown(&pair[1].value)),
            "give each frame a name of its own",
        );
    }
}
