//! The rate of a camera of ROS 2 against what a pipeline takes: its images are listened to for some seconds.

use std::collections::BTreeSet;
use std::process::Command;
use std::time::Duration;

use serde::Deserialize;
use stillpoint_pipeline::graph::{Graph, OperatorNode};

use super::finding::Finding;
use crate::rates::Interval;

/// Fewer intervals say nothing of their spread.
const FEW: usize = 10;
/// The longest interval, as a multiple of the median, from which on images come in bursts or are lost.
const BURST: f64 = 2.5;

/// What the bridge received.
#[derive(Debug, Deserialize)]
struct Received {
    connected: bool,
    topics: Vec<Topic>,
    remarks: Vec<String>,
}

/// What arrived on a topic.
#[derive(Debug, Default, Deserialize)]
struct Topic {
    topic: String,
    /// Times of arrival, ns.
    at_ns: Vec<u64>,
    other_type: u64,
}

/// What a pipeline takes of a camera.
#[derive(Debug, PartialEq)]
struct Need<'g> {
    operator: &'g str,
    /// One message is taken at a time, with this period, ns.
    every: Option<u64>,
    /// The shortest bound of the age of what follows from an image: its input, and the bound in ns.
    max_age: Option<(String, u64)>,
}

impl<'g> Need<'g> {
    fn of(graph: &'g Graph, operator: usize) -> Self {
        let node = &graph.operators[operator];
        let mut downstream = BTreeSet::from([operator]);
        // Upstream stands before downstream.
        let mut bounds = Vec::new();
        for (number, consumer) in graph.operators.iter().enumerate() {
            let of_camera = consumer.fed().filter(|(_, edge)| downstream.contains(&edge.operator));
            let ports: Vec<usize> = of_camera.map(|(port, _)| port).collect();
            for port in ports {
                downstream.insert(number);
                let input = format!("{}.{}", consumer.name, consumer.stage.kind.inputs[port].name);
                bounds.extend(consumer.inputs[port].max_age.map(|age| (age.max, input)));
            }
        }
        let max_age = bounds.into_iter().min().map(|(max, input)| (input, max));
        Self { operator: &node.name, every: node.every, max_age }
    }

    fn words(&self) -> String {
        let hz = |ns: u64| 1e9 / ns.max(1) as f64;
        let most = self.every.map(|ns| format!("at most {:.0} Hz (`every` of {})", hz(ns), self.operator));
        let least = self
            .max_age
            .as_ref()
            .map(|(input, ns)| format!("more than {:.1} Hz (`max_age` of {input})", hz(*ns)));
        let all: Vec<String> = least.into_iter().chain(most).collect();
        if all.is_empty() { "any rate".to_owned() } else { all.join(", ") }
    }

    /// The judgement of a topic of images.
    fn finding(&self, found: &Topic, remarks: &[String]) -> Finding {
        let setting = format!("rate of {}", found.topic);
        let requested = self.words();
        if found.at_ns.is_empty() {
            let about: Vec<&str> =
                remarks.iter().filter(|r| r.contains(&found.topic)).map(String::as_str).collect();
            let (message, mend) = match found.other_type {
                0 => ("no message".to_owned(), "start the driver of the camera (`ros2 topic hz TOPIC`)"),
                n => {
                    (format!("{n} messages of another type"), "set `messages` of the operator to their type")
                }
            };
            let message = std::iter::once(message.as_str()).chain(about).collect::<Vec<_>>().join("; ");
            return Finding::bad(&setting, requested, message, mend).lasting();
        }
        let Some(interval) = Interval::of(&found.at_ns) else {
            return Finding::unknown(&setting, requested, "one message: listen longer (`--for`)");
        };
        let message = format!(
            "{:.1} Hz, jitter {:.1} ms, longest interval {:.1} ms, {} messages",
            1e3 / interval.mean.max(f64::MIN_POSITIVE),
            interval.jitter,
            interval.max,
            found.at_ns.len(),
        );
        let bad = |mend: String| Finding::bad(&setting, requested.as_str(), message.as_str(), mend).lasting();
        if let Some(every) = self.every.filter(|ns| *ns as f64 * 1e-6 > interval.mean) {
            let (has, enough) = (every as f64 * 1e-6, interval.mean / 2.0);
            return bad(format!(
                "messages are lost: set `every` of `{}` to {enough:.1} ms (it is {has:.1} ms), or lower the rate of the camera",
                self.operator
            ));
        }
        if let Some((input, max)) = self.max_age.as_ref().filter(|(_, ns)| *ns as f64 * 1e-6 <= interval.p99)
        {
            return bad(format!(
                "99 % of the intervals reach {:.1} ms: raise the rate of the camera, or `max_age` of {input} ({:.1} ms)",
                interval.p99,
                *max as f64 * 1e-6
            ));
        }
        if found.at_ns.len() > FEW && interval.max > BURST * interval.p50 {
            return bad(
                "images are lost or come in bursts: look at cable, network and exposure of the camera"
                    .to_owned(),
            )
            .hint();
        }
        Finding::good(&setting, requested, message)
    }
}

/// Listens for this time to what the operators of a pipeline take of ROS 2. `bridge` starts `stillpoint-bridge`.
pub fn rates(graph: &Graph, time: Duration, bridge: Command) -> Vec<Finding> {
    let cameras: Vec<(usize, &OperatorNode)> =
        graph.operators.iter().enumerate().filter(|(_, o)| !o.subscriptions.is_empty()).collect();
    let (Some(ros2), false) = (&graph.ros2, cameras.is_empty()) else { return Vec::new() };
    let received = match receive(&ros2.connect, ros2.domain, time, &cameras, bridge) {
        Ok(received) => received,
        Err(reason) => return vec![Finding::unknown("cameras of ROS 2", "messages", reason.to_string())],
    };
    if !received.connected {
        let setting = format!("router of ROS 2 at {}", ros2.connect);
        let mend = "start `ros2 run rmw_zenoh_cpp rmw_zenohd`, and the driver of the camera";
        return vec![Finding::bad(&setting, "it answers", "it does not answer", mend).hint()];
    }
    let none = Topic::default();
    let of = |topic: &str| received.topics.iter().find(|t| t.topic == topic).unwrap_or(&none);
    let mut findings = Vec::new();
    for (number, node) in cameras {
        let mut subscriptions = node.subscriptions.iter();
        let Some(images) = subscriptions.next() else { continue };
        findings.push(Need::of(graph, number).finding(of(&images.topic), &received.remarks));
        for other in subscriptions {
            findings.push(description(of(&other.topic), &other.topic));
        }
    }
    findings
}

/// The judgement of the topic that describes a camera, without which its images are not taken.
fn description(found: &Topic, topic: &str) -> Finding {
    let (setting, requested) = (format!("description of the camera on {topic}"), "at least one message");
    match found.at_ns.len() {
        0 => {
            let mend = "let the driver publish it, or name its topic in `camera_info`";
            Finding::bad(&setting, requested, "no message", mend).lasting()
        }
        n => Finding::good(&setting, requested, format!("{n} messages")),
    }
}

/// Starts the bridge, which listens. An error is what it printed.
fn receive(
    connect: &str,
    domain: u32,
    time: Duration,
    cameras: &[(usize, &OperatorNode)],
    mut bridge: Command,
) -> Result<Received, Silent> {
    bridge.args(["listen", "--connect", connect, "--domain", &domain.to_string()]);
    bridge.args(["--seconds", &time.as_secs_f64().to_string()]);
    let subscriptions = cameras.iter().flat_map(|(_, node)| &node.subscriptions);
    bridge.args(subscriptions.map(|s| format!("{}={}", s.topic, s.type_name)).collect::<BTreeSet<_>>());
    let done = bridge.output()?;
    if !done.status.success() {
        let text = String::from_utf8_lossy(&done.stderr).trim().to_owned();
        return Err(Silent::Failed(text));
    }
    Ok(serde_json::from_slice(&done.stdout)?)
}

/// Why nothing is known of what arrives.
#[derive(Debug, thiserror::Error)]
enum Silent {
    #[error("stillpoint-bridge cannot be started: {0}")]
    Start(#[from] std::io::Error),
    #[error("stillpoint-bridge ended: {0}")]
    Failed(String),
    #[error("the output of stillpoint-bridge cannot be read, as of another version: {0}")]
    Output(#[from] serde_json::Error),
}

#[cfg(test)]
mod tests {
    use super::super::Verdict;
    use super::*;

    const MS: u64 = 1_000_000;

    fn topic(at_ms: impl IntoIterator<Item = u64>) -> Topic {
        Topic { topic: "/depth".into(), at_ns: at_ms.into_iter().map(|t| t * MS).collect(), other_type: 0 }
    }

    fn need(every: Option<u64>, max_age: Option<u64>) -> Need<'static> {
        let max_age = max_age.map(|ms| ("face.cloud".to_owned(), ms * MS));
        Need { operator: "camera", every: every.map(|ms| ms * MS), max_age }
    }

    #[test]
    fn a_rate_between_both_bounds_is_good_and_one_beyond_them_names_the_key_to_change() {
        let each_33 = topic((0..60).map(|i| i * 33));
        let good = need(Some(2), Some(100)).finding(&each_33, &[]);
        let required = "more than 10.0 Hz (`max_age` of face.cloud), at most 500 Hz (`every` of camera)";
        assert_eq!((good.verdict, good.requested.as_str()), (Verdict::Good, required));
        assert_eq!(good.found, "30.3 Hz, jitter 0.0 ms, longest interval 33.0 ms, 60 messages");
        let fast = need(Some(40), None).finding(&each_33, &[]);
        assert_eq!(fast.verdict, Verdict::Bad);
        assert!(fast.mend.contains("set `every` of `camera` to 16.5 ms (it is 40.0 ms)"), "{}", fast.mend);
        let slow = need(Some(2), Some(30)).finding(&each_33, &[]);
        assert_eq!(slow.verdict, Verdict::Bad);
        assert!(slow.mend.contains("`max_age` of face.cloud (30.0 ms)"), "{}", slow.mend);
    }

    #[test]
    fn a_camera_that_is_silent_or_of_another_type_is_bad_with_what_is_known_of_it() {
        let remarks = ["no publisher of /depth in the domain 0".to_owned(), "about /other".to_owned()];
        let silent = need(None, None).finding(&topic([]), &remarks);
        assert_eq!(silent.verdict, Verdict::Bad);
        assert_eq!(silent.found, "no message; no publisher of /depth in the domain 0");
        let other = need(None, None).finding(&Topic { other_type: 7, ..topic([]) }, &[]);
        assert_eq!(other.found, "7 messages of another type");
        assert_eq!(need(None, None).finding(&topic([1]), &[]).verdict, Verdict::Unknown);
    }

    #[test]
    fn images_that_are_lost_on_the_road_are_a_hint() {
        let with_gap = topic((0..20).chain(24..44).map(|i| i * 33));
        let found = need(Some(2), None).finding(&with_gap, &[]);
        assert_eq!(found.verdict, Verdict::Unknown);
        assert!(found.mend.contains("lost"), "{}", found.mend);
    }
}
