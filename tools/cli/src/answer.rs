//! The answers of operators to what a person asks for, and to targets.

use std::time::{Duration, Instant};

use stillpoint_operator::Registry;
use stillpoint_pipeline::graph::Graph;
use stillpoint_samples::{Refusal, Sample, SampleKind, Target, TargetElement, Verb};

use crate::attach::Which;
use crate::exit::Failure;
use crate::tap::Tap;
use stillpoint_report::target_refusals::words;

/// Time within which an operator has to answer.
const PATIENCE: Duration = Duration::from_secs(1);
/// Interval at which its topic is read.
pub const LOOK: Duration = Duration::from_millis(5);

/// The operators that take a command of a console and answer with samples of a kind, with that output.
pub fn answering(graph: &Graph, console: &str, verb: Verb, kind: &SampleKind) -> Vec<(usize, usize)> {
    let port = Verb::ALL.iter().position(|(_, v)| *v == verb).unwrap_or_default();
    let Some(console) = graph.operator(console) else { return Vec::new() };
    let output = |operator: usize| {
        let outputs = graph.operators[operator].stage.kind.outputs;
        Some((operator, outputs.iter().position(|o| *o.sample == *kind)?))
    };
    graph.consumers(console, port).filter_map(|(operator, _)| output(operator)).collect()
}

/// Reads the answers of one operator that takes targets of people.
pub struct Listener {
    tap: Tap,
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
            Self::Refused(why) => format!("{topic}: refused, because {why}; the previous target holds"),
            Self::Silence => format!(
                "{topic}: no answer within {} s; `stillpoint echo {topic}` shows `asked`, `status` and `refusal`",
                PATIENCE.as_secs()
            ),
        }
    }
}

/// Opens a listener for each operator that takes targets of a console, before a target is sent.
pub fn listen(registry: &Registry, which: &Which, console: &str) -> Result<Vec<Listener>, Failure> {
    let attached = which.attach(registry)?;
    let mut listeners = Vec::new();
    for (operator, output) in answering(&attached.graph, console, Verb::Target, Target::KIND) {
        let mut listener = Listener { tap: Tap::open(&attached, operator, output)?, asked: None };
        listener.asked = listener.wait(|_| true)?.map(|target| target.asked);
        listeners.push(listener);
    }
    Ok(listeners)
}

impl Listener {
    /// The topic that it reads.
    pub fn topic(&self) -> &str {
        &self.tap.name
    }

    /// The answer of the operator to the target that was sent since.
    pub fn answer(&self) -> Result<Answer, Failure> {
        let Some(before) = self.asked else { return Ok(Answer::Silence) };
        let reported = self.wait(|target| target.asked != before)?;
        Ok(reported.as_ref().map_or(Answer::Silence, answer))
    }

    /// The next target for which `is_so` holds.
    fn wait(&self, is_so: impl Fn(&TargetElement) -> bool) -> Result<Option<TargetElement>, Failure> {
        let begun = Instant::now();
        while begun.elapsed() < PATIENCE {
            while let Some(sample) = self.tap.next()? {
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
