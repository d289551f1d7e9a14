//! What becomes of a target that a person asks for: what the operators say that take it.

use std::time::{Duration, Instant};

use stillpoint_operator::Registry;
use stillpoint_pipeline::live::contracts;
use stillpoint_samples::{Refusal, Sample, Target, TargetElement, Verb};
use stillpoint_shm::{Subscriber, Topic};

use crate::attach::{Attached, Which};
use crate::exit::Failure;
use stillpoint_report::target_refusals::words;

/// How long an operator may be silent.
const PATIENCE: Duration = Duration::from_secs(1);
/// How often its topic is looked at.
const LOOK: Duration = Duration::from_millis(5);

/// Somebody who listens to an operator that takes targets of people.
pub struct Listener {
    name: String,
    subscriber: Subscriber,
    _topic: Topic,
    /// How many targets it had been asked for; none where it was silent.
    asked: Option<u32>,
}

/// What an operator says to a target.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// It goes there.
    Taken,
    /// It does not, for this reason.
    Refused(String),
    /// Nothing.
    Silence,
}

impl Answer {
    /// In a line, of the operator's topic.
    pub fn line(&self, topic: &str) -> String {
        match self {
            Self::Taken => format!("{topic}: taken"),
            Self::Refused(why) => format!("{topic}: refused, because {why}; the target before stands"),
            Self::Silence => format!(
                "{topic}: no answer within {} s; `stillpoint echo {topic}` shows `asked`, `status` and `refusal`",
                PATIENCE.as_secs()
            ),
        }
    }
}

/// Listens to all that take targets of a console, before one is sent.
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
    /// The topic it listens to.
    pub fn topic(&self) -> &str {
        &self.name
    }

    /// What the operator says to the target that was asked for since.
    pub fn answer(&self) -> Result<Answer, Failure> {
        let Some(before) = self.asked else { return Ok(Answer::Silence) };
        let told = self.wait(|target| target.asked != before)?;
        Ok(told.as_ref().map_or(Answer::Silence, answer))
    }

    /// The next target that is so.
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
