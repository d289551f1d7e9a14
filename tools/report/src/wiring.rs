//! The operators of a session and the edges between them, from its journals. The kinds need not be known to this build.

use std::collections::BTreeSet;

use stillpoint_pipeline::graph::{Edge, Graph, settings_topic};
use stillpoint_recorder::{Role, Session};
use stillpoint_samples::{Cause, Entry};

/// An operator with its topics.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Stage {
    /// Name of the operator.
    pub name: String,
    /// Topic of each input; empty if the input is not connected.
    pub inputs: Vec<String>,
    /// Topic of each output.
    pub outputs: Vec<String>,
}

/// The operators of a session, upstream first.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Wiring {
    stages: Vec<Stage>,
}

impl Stage {
    /// An operator with its topics. Changes of parameters are no samples that its steps see: their input counts as not
    /// connected.
    fn of(name: &str, mut inputs: Vec<String>, outputs: Vec<String>) -> Self {
        let answers = settings_topic(name);
        if outputs.last().is_some_and(|last| *last == answers)
            && let Some(set) = inputs.last_mut()
        {
            set.clear();
        }
        Self { name: name.to_owned(), inputs, outputs }
    }
}

impl Wiring {
    /// The wiring that a session states.
    pub fn of(session: &Session) -> Self {
        let stages = session.topics().iter().filter_map(|topic| match &topic.role {
            Role::Journal { inputs, outputs } => {
                Some(Stage::of(&topic.operator, inputs.clone(), outputs.clone()))
            }
            _ => None,
        });
        Self { stages: stages.collect() }
    }

    /// The wiring of a pipeline.
    pub fn of_graph(graph: &Graph) -> Self {
        let topic = |edge: &Edge| graph.operators[edge.operator].outputs[edge.output].topic.clone();
        let stages = graph.operators.iter().map(|node| {
            let inputs = node.inputs.iter().map(|i| i.edge.as_ref().map(topic).unwrap_or_default());
            Stage::of(&node.name, inputs.collect(), node.outputs.iter().map(|o| o.topic.clone()).collect())
        });
        Self { stages: stages.collect() }
    }

    pub fn stages(&self) -> &[Stage] {
        &self.stages
    }

    /// The operator that sends a topic, and the number of its output.
    pub fn producer(&self, topic: &str) -> Option<(&Stage, usize)> {
        self.stages.iter().find_map(|s| Some((s, s.outputs.iter().position(|o| o == topic)?)))
    }

    /// The operators that take a topic.
    pub fn consumers<'a>(&'a self, topic: &'a str) -> impl Iterator<Item = &'a Stage> {
        self.stages.iter().filter(move |s| s.inputs.iter().any(|i| i == topic))
    }

    /// A topic and all topics upstream of it, the nearest first.
    pub fn upstream<'a>(&'a self, topic: &'a str) -> Vec<&'a str> {
        let (mut found, mut seen) = (vec![topic], BTreeSet::from([topic]));
        let mut at = 0;
        while at < found.len() {
            let inputs = self.producer(found[at]).map_or(&[][..], |(stage, _)| &stage.inputs);
            for input in inputs.iter().filter(|i| !i.is_empty()) {
                if seen.insert(input) {
                    found.push(input);
                }
            }
            at += 1;
        }
        found
    }
}

/// Whether an entry is an activation.
pub fn is_activation(entry: &Entry) -> bool {
    !matches!(entry.cause(), None | Some(Cause::Start | Cause::End | Cause::Set))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn upstream_goes_to_the_sources_and_comes_to_an_end_in_a_cycle() {
        let stage = |name: &str, inputs: &[&str], outputs: &[&str]| Stage {
            name: name.into(),
            inputs: inputs.iter().map(|t| t.to_string()).collect(),
            outputs: outputs.iter().map(|t| t.to_string()).collect(),
        };
        let wiring = Wiring {
            stages: vec![
                stage("rig", &["law.duty"], &["rig.depth", "rig.truth"]),
                stage("cloud", &["rig.depth", ""], &["cloud.cloud"]),
                stage("law", &["cloud.cloud"], &["law.duty"]),
            ],
        };
        assert_eq!(wiring.upstream("law.duty"), ["law.duty", "cloud.cloud", "rig.depth"]);
        assert_eq!(wiring.producer("rig.truth").map(|(s, port)| (s.name.as_str(), port)), Some(("rig", 1)));
        assert_eq!(wiring.upstream("nobody.port"), ["nobody.port"]);
        assert_eq!(wiring.consumers("cloud.cloud").map(|s| s.name.as_str()).collect::<Vec<_>>(), ["law"]);
    }
}
