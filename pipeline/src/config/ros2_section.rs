//! The section `ros2`: the router of ROS 2, and what of the pipeline is published there.

use stillpoint_ros2::{LARGEST_DOMAIN, TopicName};

use super::faults::{Code, Findings};
use super::fields::{count, missing};
use super::inputs::{Topic, topic_at};
use super::near::shown;
use super::source::{Marked, Span};
use super::tree::{Entry, Keys, Node};
use crate::hosts::is_address;

/// Keys of the section.
pub const KEYS: &[&str] = &["connect", "domain", "publish"];
/// Keys of a publication.
pub const PUBLICATION_KEYS: &[&str] = &["topic", "type", "tf"];
/// The longest name of a frame of ROS 2, bytes.
const LONGEST_FRAME: usize = 255;

/// The section as it was written.
pub struct ParsedRos2 {
    /// Endpoint of the router; empty where it is at fault.
    pub connect: String,
    /// The domain.
    pub domain: u32,
    /// What is published.
    pub publish: Vec<ParsedPublication>,
    /// Where its name stands.
    pub span: Span,
    /// Where all of it stands.
    pub whole: Span,
}

/// A topic that is published, as it was written.
pub struct ParsedPublication {
    /// The topic of the pipeline.
    pub of: Marked<Topic>,
    /// The topic of ROS 2.
    pub topic: Option<Marked<TopicName>>,
    /// Name of the message's type.
    pub message: Option<Marked<String>>,
    /// The frame that a pose places on `/tf`.
    pub frame: Option<Marked<String>>,
}

/// Reads the section.
pub fn read(entry: &Entry, findings: &Findings) -> ParsedRos2 {
    let span = entry.key.span;
    let expected = "a mapping with `connect: tcp/127.0.0.1:7447`";
    let Some(entries) = entry.value.map("`ros2`", expected, findings) else {
        let connect = String::new();
        return ParsedRos2 { connect, domain: 0, publish: Vec::new(), span, whole: entry.value.span };
    };
    let keys = Keys::of(entries, KEYS, "`ros2`", findings);
    let connect = match keys.get("connect") {
        Some(entry) => endpoint(&entry.value, findings),
        None => {
            missing("`ros2`", "connect", "tcp/127.0.0.1:7447", span, findings);
            None
        }
    };
    let domain = keys.get("domain").and_then(|e| count(e, 0, LARGEST_DOMAIN, findings)).unwrap_or(0);
    let expected = "a mapping from topics to { topic: /NAME }";
    let publish = keys.get("publish").and_then(|e| e.value.map("`publish`", expected, findings));
    let publish = publish.unwrap_or_default().iter().filter_map(|e| publication(e, findings)).collect();
    ParsedRos2 { connect: connect.unwrap_or_default(), domain, publish, span, whole: entry.value.span }
}

fn endpoint(node: &Node, findings: &Findings) -> Option<String> {
    let text = node.scalar("`connect`", "an endpoint", findings)?;
    let stands = text.strip_prefix("tcp/").is_some_and(is_address);
    if !stands {
        findings.say(
            node.span,
            Code::WrongShape,
            format!("{} is not an endpoint of a router of ROS 2", shown(text)),
            "write `tcp/ADDRESS:PORT`, for example `tcp/127.0.0.1:7447`, where `rmw_zenohd` listens",
        );
    }
    stands.then(|| text.to_owned())
}

fn publication(entry: &Entry, findings: &Findings) -> Option<ParsedPublication> {
    let of = topic_at(&entry.key.value, entry.key.span, findings)?;
    let entries = entry.value.map(&shown(&entry.key.value), "{ topic: /head_pose }", findings)?;
    let keys = Keys::of(entries, PUBLICATION_KEYS, "a topic that is published", findings);
    let text = |key: &str, expected: &str| {
        let entry = keys.get(key)?;
        let text = entry.value.scalar(&shown(key), expected, findings)?;
        Some(Marked::new(text.to_owned(), entry.value.span))
    };
    let topic = text("topic", "the name of a topic of ROS 2").and_then(|text| ros_topic(&text, findings));
    let frame = text("tf", "the name of a frame").and_then(|text| is_frame(&text, findings).then_some(text));
    let message = text("type", "the type of a message");
    if keys.get("topic").is_none() && keys.get("tf").is_none() {
        missing("a topic that is published", "topic", "/head_pose", entry.key.span, findings);
    } else if let (Some(message), None) = (&message, keys.get("topic")) {
        findings.say(
            message.span,
            Code::WrongShape,
            "`type` is that of the messages on `topic`, which is missing",
            "add `topic: /NAME`, or remove `type`",
        );
    }
    Some(ParsedPublication { of, topic, message, frame })
}

/// The topic of ROS 2 of this name.
fn ros_topic(text: &Marked<String>, findings: &Findings) -> Option<Marked<TopicName>> {
    let refuse = |message: String, help: String| {
        findings.say(text.span, Code::BadName, message, help);
        None
    };
    match TopicName::parse(&text.value) {
        Ok(name) if matches!(name.as_str(), "/tf" | "/tf_static") => refuse(
            format!("{} is for the places of frames", shown(&text.value)),
            "write `tf: FRAME` with the name of the frame that the pose places".to_owned(),
        ),
        Ok(name) => Some(Marked::new(name, text.span)),
        Err(reason) => refuse(
            format!("{} names no topic of ROS 2: {reason}", shown(&text.value)),
            "write a name such as `/head_pose`".to_owned(),
        ),
    }
}

fn is_frame(text: &Marked<String>, findings: &Findings) -> bool {
    let name = &text.value;
    let is_plain = |b: u8| b.is_ascii_alphanumeric() || b"_-./".contains(&b);
    let stands = !name.is_empty()
        && name.len() <= LONGEST_FRAME
        && !name.starts_with('/')
        && name.bytes().all(is_plain);
    if !stands {
        findings.say(
            text.span,
            Code::BadName,
            format!("{} cannot name a frame of ROS 2", shown(name)),
            "write letters, digits, `_`, `-`, `.` and `/`, and no `/` first: for example `head`",
        );
    }
    stands
}
