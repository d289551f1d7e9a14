//! Who publishes and takes which topic of ROS 2, from the liveliness tokens of others, as far as it is about topics of
//! this node.

use std::collections::{BTreeMap, VecDeque};

use stillpoint_ros2::{EndKind, Ended, who};

use crate::HostEvent;

/// Messages that wait to be read; one more is not kept.
const MOST_EVENTS: usize = 64;
/// Topics of others that are known.
const MOST_TOPICS: usize = 1_000;
/// Topics that are named to a person.
const MOST_NAMED: usize = 5;

/// Who publishes and takes which topic.
#[derive(Default)]
pub struct RosGraph {
    /// Topics that this node takes, with their types.
    taken: BTreeMap<String, String>,
    /// Topics that this node publishes.
    given: Vec<String>,
    /// Topics that others publish: type, and how many publish it.
    published: BTreeMap<String, (String, usize)>,
    events: VecDeque<HostEvent>,
}

impl RosGraph {
    /// This node takes a topic.
    pub fn takes(&mut self, topic: &str, type_name: &str) {
        self.taken.insert(topic.to_owned(), type_name.to_owned());
    }

    /// This node publishes a topic.
    pub fn gives(&mut self, topic: &str) {
        self.given.push(topic.to_owned());
    }

    /// What happened since the last call.
    pub fn events(&mut self) -> Vec<HostEvent> {
        self.events.drain(..).collect()
    }

    /// Tells something.
    pub fn note(&mut self, text: String, is_fault: bool) {
        if self.events.len() < MOST_EVENTS {
            self.events.push_back(HostEvent { text, is_fault });
        }
    }

    /// A token of another node came, or went.
    pub fn token(&mut self, key: &str, is_here: bool) {
        let Some(Ended { kind, node, topic, type_name }) = who(key) else { return };
        if kind == EndKind::Publisher {
            self.count(&topic, &type_name, is_here);
        }
        match (kind, self.taken.get(&topic)) {
            (EndKind::Publisher, Some(due)) if is_here && *due != type_name => {
                let text = format!("ROS 2: {node} publishes {topic} as {type_name}, and {due} is taken");
                self.note(text, true);
            }
            (EndKind::Publisher, Some(_)) => {
                let does = if is_here { "publishes" } else { "no longer publishes" };
                self.note(format!("ROS 2: {node} {does} {topic}"), false);
            }
            (EndKind::Subscription, _) if self.given.contains(&topic) => {
                let does = if is_here { "takes" } else { "no longer takes" };
                self.note(format!("ROS 2: {node} {does} {topic}"), false);
            }
            _ => {}
        }
    }

    fn count(&mut self, topic: &str, type_name: &str, is_here: bool) {
        if is_here {
            if self.published.len() < MOST_TOPICS || self.published.contains_key(topic) {
                self.published.entry(topic.to_owned()).or_insert((type_name.to_owned(), 0)).1 += 1;
            }
        } else if let Some((_, count)) = self.published.get_mut(topic) {
            *count -= 1;
            if *count == 0 {
                self.published.remove(topic);
            }
        }
    }

    /// Tells which of the topics that this node takes nobody publishes, and what there is of their types.
    pub fn report_missing(&mut self, domain: u32) {
        let mut missing = Vec::new();
        for (topic, due) in self.taken.iter().filter(|(topic, _)| !self.published.contains_key(*topic)) {
            let others: Vec<&str> = self
                .published
                .iter()
                .filter(|(_, (type_name, _))| type_name == due)
                .map(|(other, _)| other.as_str())
                .take(MOST_NAMED)
                .collect();
            let there = match others.is_empty() {
                true => format!("there is no topic of {due}"),
                false => format!("topics of {due}: {}", others.join(", ")),
            };
            missing.push(format!("ROS 2: no publisher of {topic} in the domain {domain}; {there}"));
        }
        missing.into_iter().for_each(|text| self.note(text, true));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const IMAGE: &str = "sensor_msgs::msg::dds_::Image_/RIHS01_0/2::,5:,:,:,,";
    const CLOUD: &str = "sensor_msgs::msg::dds_::PointCloud2_/RIHS01_0/2::,5:,:,:,,";

    fn token(kind: &str, topic: &str, rest: &str) -> String {
        format!("@ros2_lv/0/ab/0/1/{kind}/%/%cam/driver/{topic}/{rest}")
    }

    fn texts(graph: &mut RosGraph) -> Vec<(String, bool)> {
        graph.events().into_iter().map(|e| (e.text, e.is_fault)).collect()
    }

    #[test]
    fn what_others_do_with_own_topics_is_told_and_nothing_else() {
        let mut graph = RosGraph::default();
        graph.takes("/depth", "sensor_msgs/msg/Image");
        graph.gives("/pose");
        graph.token(&token("MP", "%colour", IMAGE), true);
        graph.token("@ros2_lv/0/ab/0/0/NN/%/%cam/driver", true);
        graph.report_missing(0);
        let due = "ROS 2: no publisher of /depth in the domain 0; topics of sensor_msgs/msg/Image: /colour";
        assert_eq!(texts(&mut graph), [(due.to_owned(), true)]);
        graph.token(&token("MP", "%depth", IMAGE), true);
        graph.token(&token("MS", "%pose", IMAGE), true);
        graph.token(&token("MP", "%depth", IMAGE), false);
        graph.token(&token("MP", "%depth", CLOUD), true);
        graph.report_missing(0);
        let reported = [
            ("ROS 2: /cam/driver publishes /depth", false),
            ("ROS 2: /cam/driver takes /pose", false),
            ("ROS 2: /cam/driver no longer publishes /depth", false),
            (
                "ROS 2: /cam/driver publishes /depth as sensor_msgs/msg/PointCloud2, and sensor_msgs/msg/Image is taken",
                true,
            ),
        ];
        assert_eq!(texts(&mut graph), reported.map(|(text, is_fault)| (text.to_owned(), is_fault)));
    }

    #[test]
    fn a_flood_of_tokens_takes_bounded_memory() {
        let mut graph = RosGraph::default();
        graph.gives("/pose");
        for number in 0..5_000 {
            graph.token(&token("MP", &format!("%t{number}"), IMAGE), true);
            graph.token(&token("MS", "%pose", IMAGE), true);
            graph.token(&token("MP", "%unknown", IMAGE), false);
        }
        assert_eq!((graph.published.len(), graph.events.len()), (MOST_TOPICS, MOST_EVENTS));
    }
}
