//! The topics of a run that state how the head is held and whether operators answered, read as `echo` reads them.

use std::collections::BTreeSet;

use stillpoint_pipeline::live::contracts;
use stillpoint_report::hold::{Held, Hold};
use stillpoint_report::unanswered::Answers;
use stillpoint_shm::{Subscriber, Topic};

use crate::attach::Attached;
use crate::exit::Failure;

/// Which topics are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Read {
    /// All of them.
    All,
    /// Those that the session does not keep, and those of which no sample may be missed.
    NotRetained,
}

/// Subscriptions to these topics. The run that they belong to outlives them.
pub struct HeldTaps {
    hold: Hold,
    /// What operators answered.
    pub answers: Answers,
    // Ports are dropped before their topics.
    subscribers: Vec<(String, Subscriber)>,
    _topics: Vec<Topic>,
}

impl HeldTaps {
    /// Opens the topics.
    pub fn open(attached: &Attached, read: Read) -> Result<Self, Failure> {
        let (hold, answers) = (Hold::of(&attached.graph), Answers::of(&attached.graph));
        let valves = Hold::of_valves(&attached.graph);
        let names: BTreeSet<&str> = hold.topics().chain(answers.topics()).collect();
        let (mut subscribers, mut topics) = (Vec::new(), Vec::new());
        for name in names {
            let Some((operator, port)) = attached.graph.topic(name) else { continue };
            let is_valve = valves.topics().any(|valve| valve == name);
            let is_retained = attached.session.is_some() && attached.graph.is_recorded(operator, port);
            if is_retained && !is_valve && read == Read::NotRetained {
                continue;
            }
            let contract = contracts::output(&attached.graph, operator, port);
            let topic = Topic::open(&attached.domain, &contract).map_err(Failure::failed)?;
            // No vent may be overwritten between two looks.
            let depth = if is_valve { contract.buffer } else { contracts::TAP_DEPTH };
            let subscriber = topic.subscriber(depth).map_err(Failure::failed)?;
            subscriber.connect().map_err(Failure::failed)?;
            subscribers.push((name.to_owned(), subscriber));
            topics.push(topic);
        }
        Ok(Self { hold, answers, subscribers, _topics: topics })
    }

    /// Reads what came since the last look.
    pub fn look(&mut self) -> Held {
        for (topic, subscriber) in &self.subscribers {
            while let Ok(Some(sample)) = subscriber.receive() {
                self.hold.take(topic, sample.pieces());
                self.answers.take(topic, sample.pieces());
            }
        }
        self.hold.held()
    }
}
