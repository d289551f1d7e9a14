//! The answers of operators to a target that a person asks for.

use std::time::{Duration, Instant};

use stillpoint_operator::Registry;
use stillpoint_pipeline::live::contracts;
use stillpoint_samples::{Refusal, Sample, Target, TargetElement, Verb};
use stillpoint_shm::{Subscriber, Topic};

use crate::attach::{Attached, Which};
use crate::exit::Failure;
use stillpoint_report::target_refusals::words;

/// Time within which an operator has to answer.
const PATIENCE: Duration = Duration::from_secs(1);
/// Interval at which its topic is read.
const LOOK: Duration = Duration::from_millis(5);

/// Reads the answers of one operator that takes targets of people.
pub struct Listener {
    name: String,
    subscriber: Subscriber,
    _topic: Topic,
    /// Targets that it had been asked for before; none if it was silent.
    asked: Option<u32>,
}

/// The answer of an operator to a target.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// The operator takes the target.
    Taken,
    /// The operator refuses the target, for this reason.
    Refused(String),
    /// The operator did not answer.
    Silence,
}

impl Answer {
    /// The answer as a line that names the topic of the operator.
    pub fn line(&self, topic: &str) -> String {
        match self {
            Self::Taken => format!("{topic}: taken"),
            Self::Refused(why) => format!("{topic}: refused, because {why}; the previous target is kept"),
            Self::Silence => format!(
                "{topic}: no answer within {} s; `stillpoint echo {topic}` shows `asked`, `status` and `refusal`",
                PATIENCE.as_secs()
            ),
        }
    }
}

/// Opens a listener for each operator that takes targets of a console, before a target is sent.
pub fn listen(registry: &Registry, which: &Which, console: &str) -> Result<Vec<Listener>, Failure> {
    let Attached { graph, domain, .. } = which.attach(registry)?;
    let port = Verb::ALL.iter().position(|(_, verb)| *verb == Verb::Target).unwrap_or_default();
    let Some(console) = graph.operator(console) else { return Ok(Vec::new()) };
    let mut listeners = Vec::new();
    for (operator, _) in graph.consumers(console, port) {
        let outputs = graph.operators[operator].stage.kind.outputs;
        let Some(output) = outputs.iter().position(|o| o.sample.name == Target::NAME) else { continue };
        let contract = contracts::output(&graph, operator, output);
        let topic = Topic::open(&domain, &contract).map_err(Failure::failed)?;
        let subscriber = topic.subscriber(contracts::TAP_DEPTH).map_err(Failure::failed)?;
        subscriber.connect().map_err(Failure::failed)?;
        let name = contract.topic;
        let mut listener = Listener { name, subscriber, _topic: topic, asked: None };
        listener.asked = listener.wait(|_| true)?.map(|target| target.asked);
        listeners.push(listener);
    }
    Ok(listeners)
}

impl Listener {
    /// The topic that it reads.
    pub fn topic(&self) -> &str {
        &self.name
    }

    /// The answer of the operator to the target that was sent since.
    pub fn answer(&self) -> Result<Answer, Failure> {
        let Some(before) = self.asked else { return Ok(Answer::Silence) };
        let told = self.wait(|target| target.asked != before)?;
        Ok(told.as_ref().map_or(Answer::Silence, answer))
    }

    /// The next target for which `is_so` holds.
    fn wait(&self, is_so: impl Fn(&TargetElement) -> bool) -> Result<Option<TargetElement>, Failure> {
        let begun = Instant::now();
        while begun.elapsed() < PATIENCE {
            while let Some(sample) = self.subscriber.receive().map_err(Failure::failed)? {
                let view = sample.pieces().view::<Target>().map_err(Failure::failed)?;
                if let Some(target) = view.first().filter(|target| is_so(target)) {
                    return Ok(Some(*target));
                }
            }
            std::thread::sleep(LOOK);
        }
        Ok(None)
    }
}

fn answer(target: &TargetElement) -> Answer {
    if target.refusal == Refusal::None as u32 { Answer::Taken } else { Answer::Refused(words(target)) }
}
