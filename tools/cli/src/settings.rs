//! The values of parameters of a run or a session, and where each came from.

use serde::Serialize;
use serde_json::Value;
use stillpoint_operator::params::{
    CheckedParams, Origin, ParamField, ParamType, changed, live_paths, origin,
};
use stillpoint_pipeline::graph::{Graph, OperatorNode, settings_topic};
use stillpoint_pipeline::live::contracts;
use stillpoint_pipeline::live::run_folder::changes;
use stillpoint_pipeline::settings::TakenChange;
use stillpoint_recorder::Session;
use stillpoint_samples::{Cause, Pieces, Sample, SettingAnswer, SettingAnswerElement, SettingElement};
use stillpoint_shm::{Subscriber, Topic};

use crate::attach::Attached;
use crate::exit::Failure;

/// A parameter with its value.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Operator and parameter, such as `law.proportional`.
    pub parameter: String,
    /// The value in SI units.
    pub value: Value,
    /// Its unit; empty for plain numbers and words.
    pub unit: &'static str,
    /// `default`, `file`, `--set` or `live`.
    pub from: &'static str,
    /// Whether it changes while the operator runs.
    pub live: bool,
}

impl Row {
    /// The row as text.
    pub fn text(&self) -> String {
        let (value, unit) = match (&self.value, self.unit) {
            (Value::String(text), unit) => (text.clone(), unit),
            // As people write times.
            (Value::Number(ns), "ns") => (format!("{}", ns.as_f64().unwrap_or(f64::NAN) / 1e6), "ms"),
            (other, unit) => (other.to_string(), unit),
        };
        let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
        let live = if self.live { ", can be set" } else { "" };
        format!("{}: {value}{unit} ({}{live})", self.parameter, self.from)
    }
}

/// The answers of operators to changes of their parameters, as they come.
pub struct Values {
    taps: Vec<(usize, Subscriber, Topic)>,
    /// By operator: the answers of its newest incarnation, after those that it began with.
    known: Vec<(u32, Vec<SettingAnswerElement>)>,
}

impl Values {
    /// The answers of a run, those included that were given before it was joined.
    pub fn open(attached: &Attached) -> Result<Self, Failure> {
        let graph = &attached.graph;
        let mut taps = Vec::new();
        for (operator, node) in graph.operators.iter().enumerate() {
            let Some(output) = node.stage.settings_output() else { continue };
            let contract = contracts::output(graph, operator, output);
            let topic = Topic::open(&attached.domain, &contract).map_err(Failure::failed)?;
            let (subscriber, _) = topic.subscriber_with_history().map_err(Failure::failed)?;
            subscriber.connect().map_err(Failure::failed)?;
            taps.push((operator, subscriber, topic));
        }
        // An answer goes with the process that sent it; the supervisor notes what was taken.
        let mut noted = changes(&attached.folder());
        let known = graph.operators.iter().map(|node| {
            let taken = noted.remove(&node.name).unwrap_or_default();
            (0, taken.iter().filter_map(|change| answer(&node.name, change)).collect())
        });
        Ok(Self { taps, known: known.collect() })
    }

    /// The answers that a session holds.
    pub fn of_session(session: &Session, graph: &Graph) -> Self {
        let mut answers = Self { taps: Vec::new(), known: vec![Default::default(); graph.operators.len()] };
        for (operator, node) in graph.operators.iter().enumerate() {
            let Some(number) = session.topic_number(&settings_topic(&node.name)) else { continue };
            for (incarnation, sequence) in session.numbers(number) {
                let sample = session.sample(number, incarnation, sequence).ok().flatten();
                let Some(sample) = sample else { continue };
                if let Ok(pieces) = Pieces::split(SettingAnswer::KIND, &sample.sample) {
                    answers.enter(operator, pieces, begins_with(session, &node.name, incarnation));
                }
            }
        }
        answers
    }

    /// Takes an answer; `carried`: the changes with which its incarnation began, where that is known.
    fn enter(&mut self, operator: usize, pieces: Pieces<'_>, carried: Option<usize>) {
        let incarnation = pieces.header().incarnation;
        let Ok(view) = pieces.view::<SettingAnswer>() else { return };
        let (life, list) = &mut self.known[operator];
        if incarnation > *life {
            // A new incarnation begins with the changes that the ones before took.
            *life = incarnation;
            list.retain(|answer| answer.refusal().is_none());
            list.truncate(carried.unwrap_or(list.len()));
        }
        if incarnation == *life {
            list.extend(view.first());
        }
    }

    /// Reads what came since the last look.
    pub fn look(&mut self) -> Result<(), Failure> {
        for at in 0..self.taps.len() {
            while let Some(sample) = self.taps[at].1.receive().map_err(Failure::failed)? {
                self.enter(self.taps[at].0, sample.pieces(), None);
            }
        }
        Ok(())
    }

    /// The answers of an operator in its newest incarnation, oldest first, after those that it began with.
    pub fn of(&self, operator: usize) -> &[SettingAnswerElement] {
        self.known.get(operator).map_or(&[], |(_, list)| list)
    }

    /// The parameters of an operator as they are now.
    pub fn params(&self, operator: usize, node: &OperatorNode) -> CheckedParams {
        let taken = self.of(operator).iter().filter(|answer| answer.refusal().is_none());
        taken.fold(node.params.clone(), |params, answer| {
            let path = answer.path().split_once('.').map_or("", |(_, path)| path);
            changed(&node.stage, &params, path, answer.value()).unwrap_or(params)
        })
    }

    /// All parameters of an operator as they are now.
    pub fn rows(&self, operator: usize, node: &OperatorNode) -> Vec<Row> {
        let params = self.params(operator, node);
        let live = live_paths(node.stage.fields);
        let mut rows = Vec::new();
        list(node.stage.fields, "", &mut |path, field| {
            let pointer = format!("/{}", path.replace('.', "/"));
            rows.push(Row {
                parameter: format!("{}.{path}", node.name),
                value: params.resolved.pointer(&pointer).cloned().unwrap_or_default(),
                unit: field.unit,
                from: origin(&params, path).word(),
                live: live.iter().any(|known| known == path),
            });
        });
        rows
    }

    /// The parameters of all operators that were changed while they run.
    pub fn changed(&self, graph: &Graph) -> Vec<Row> {
        let all = graph.operators.iter().enumerate().filter(|(operator, _)| !self.of(*operator).is_empty());
        let rows = all.flat_map(|(operator, node)| self.rows(operator, node));
        rows.filter(|row| row.from == Origin::Live.word()).collect()
    }
}

/// The answer to a change that was taken before.
fn answer(operator: &str, change: &TakenChange) -> Option<SettingAnswerElement> {
    let path = format!("{operator}.{}", change.parameter);
    let change = SettingElement::new(&path, &change.value, "")?;
    Some(SettingAnswerElement {
        // No change that is sent has this number.
        setting: u64::MAX,
        generation: 0,
        from: 0,
        console_incarnation: u32::MAX,
        taken: 1,
        path: change.path,
        value: change.value,
        reason: [0; 256],
    })
}

/// The changes of parameters with which a recorded incarnation began.
fn begins_with(session: &Session, operator: &str, incarnation: u32) -> Option<usize> {
    let mut entries = session.journals().get(operator)?.iter();
    let start = entries.find(|e| e.header.incarnation == incarnation && e.cause() == Some(Cause::Start))?;
    usize::try_from(start.body.tick).ok()
}

fn list(fields: &'static [ParamField], before: &str, take: &mut impl FnMut(&str, &ParamField)) {
    for field in fields {
        let path = format!("{before}{}", field.name);
        match field.ty {
            ParamType::Group(nested) => list(nested, &format!("{path}."), take),
            _ => take(&path, field),
        }
    }
}
