//! Kinds, ports and types: what each operator is, and what each of its inputs is connected to.

use std::collections::BTreeMap;

use stillpoint_samples::SampleKind;

use super::document::Document;
use super::faults::{Code, Findings};
use super::inputs::{ParsedInput, Topic};
use super::near::{listed, nearest, shown, suggestion};
use super::operators::ParsedOperator;
use super::source::{Marked, Span};
use crate::far_end;
use crate::graph::{Edge, Wire};
use crate::operator::{DescribeError, Files, Registry, Stage, TIMING, Timer};

/// What stands between the file and the class of an operator in Python: `ops/speed.py:Speed`.
pub const IN_PYTHON: &str = ".py:";
/// Topics that a help line names.
const LISTED: usize = 4;

/// An operator with its kind and its edges. Numbers of operators are their places in the file.
pub struct Wired {
    /// Its kind, where it is known.
    pub stage: Option<Stage>,
    /// Its inputs, in the order of the kind's ports.
    pub inputs: Vec<WiredInput>,
}

/// An input with its edge.
#[derive(Clone, Default)]
pub struct WiredInput {
    /// Number of what the file says about it.
    pub parsed: Option<usize>,
    /// Its edge; `None` where there is none or it is at fault.
    pub edge: Option<Edge>,
    /// Where the topic stands.
    pub span: Span,
}

impl Wired {
    /// Whether the file connects an input, rightly or not.
    pub fn is_fed(&self) -> bool {
        self.inputs.iter().any(|i| i.parsed.is_some())
    }
}

/// Looks up kinds and connects inputs.
pub fn connect(
    document: &Document<'_>,
    registry: &Registry,
    files: &dyn Files,
    findings: &Findings,
) -> Vec<Wired> {
    let mut stages: Vec<Option<Stage>> =
        document.operators.iter().map(|o| stage(o, registry, files, findings)).collect();
    let numbers = document.numbers();
    for far in 0..stages.len() {
        if let Some(Wire::Host(_)) = document.operators[far].link {
            stages[far] = far_end(&document.operators[far], &numbers, &stages);
        }
    }
    let lookup = Lookup { document, stages: &stages, numbers, registry, findings };
    let wired: Vec<Vec<WiredInput>> = (0..stages.len()).map(|i| lookup.inputs(i)).collect();
    stages.into_iter().zip(wired).map(|(stage, inputs)| Wired { stage, inputs }).collect()
}

fn stage(
    parsed: &ParsedOperator<'_>,
    registry: &Registry,
    files: &dyn Files,
    findings: &Findings,
) -> Option<Stage> {
    let kind = parsed.kind.as_ref()?;
    match registry.find(&kind.value, files) {
        Some(Ok(stage)) => return Some(stage),
        Some(Err(DescribeError { reason, help })) => {
            findings.say(kind.span, Code::UnknownKind, reason, help);
        }
        None if kind.value.contains(IN_PYTHON) => findings.say(
            kind.span,
            Code::UnknownKind,
            format!("{} is an operator in Python, and this program has no interpreter", shown(&kind.value)),
            "install the package stillpoint-rt, and write `python -m stillpoint_rt` in place of `stillpoint`",
        ),
        None => unknown(kind, registry, findings),
    }
    None
}

fn unknown(kind: &Marked<String>, registry: &Registry, findings: &Findings) {
    let kinds: Vec<&str> = registry.iter().map(|s| s.kind.name).collect();
    findings.say(
        kind.span,
        Code::UnknownKind,
        format!("there is no kind of operator {}", shown(&kind.value)),
        suggestion(&kind.value, kinds.iter().copied(), "kinds", findings),
    );
}

/// The far end of an edge between hosts: of the kind that takes what is sent. What is wrong with the topic is said elsewhere.
fn far_end(
    parsed: &ParsedOperator<'_>,
    numbers: &BTreeMap<&str, usize>,
    stages: &[Option<Stage>],
) -> Option<Stage> {
    let from = parsed.inputs.first()?.from.as_ref()?;
    let producer = stages[*numbers.get(from.value.operator.value.as_str())?].as_ref()?;
    let sample = producer.kind.outputs.iter().find(|o| o.name == from.value.port.value)?.sample;
    Some(far_end::of(sample))
}

struct Lookup<'d> {
    document: &'d Document<'d>,
    stages: &'d [Option<Stage>],
    numbers: BTreeMap<&'d str, usize>,
    registry: &'d Registry,
    findings: &'d Findings,
}

impl Lookup<'_> {
    fn inputs(&self, operator: usize) -> Vec<WiredInput> {
        let parsed = &self.document.operators[operator];
        let Some(stage) = &self.stages[operator] else {
            // Its own ports are unknown, but what it names must be there.
            for input in &parsed.inputs {
                input.from.as_ref().and_then(|from| self.output(from));
            }
            return Vec::new();
        };
        let ports = stage.kind.inputs;
        let mut wired = vec![WiredInput::default(); ports.len()];
        for (number, input) in parsed.inputs.iter().enumerate() {
            let Some(port) = self.port(parsed, stage, input) else {
                input.from.as_ref().and_then(|from| self.output(from));
                continue;
            };
            wired[port].parsed = Some(number);
            let Some(from) = &input.from else { continue };
            wired[port].span = from.span;
            let Some((producer, output, sample)) = self.output(from) else { continue };
            if *sample == *ports[port].sample {
                wired[port].edge = Some(Edge { operator: producer, output, delay: input.delay });
            } else {
                self.mismatch(operator, ports[port].name, ports[port].sample, from, sample);
            }
        }
        for (port, wired) in ports.iter().zip(&wired) {
            if port.required && wired.parsed.is_none() && !parsed.has_unreadable_inputs {
                let topics = self.topics_of(port.sample, operator);
                let topic = topics.first().map_or("operator.port", String::as_str);
                self.findings.say(
                    parsed.name.span,
                    Code::MissingInput,
                    format!(
                        "`{}` ({}) needs the input `{}`, {}",
                        parsed.name.value,
                        stage.kind.name,
                        port.name,
                        with_article(port.sample.name)
                    ),
                    format!("add `{}: {topic}` to its inputs", port.name),
                );
            }
        }
        wired
    }

    /// Number of an input; a misspelled one is read as the nearest that is free, so that its faults come to light.
    fn port(&self, parsed: &ParsedOperator<'_>, stage: &Stage, input: &ParsedInput) -> Option<usize> {
        let ports = stage.kind.inputs;
        let name = &input.name.value;
        if let Some(port) = ports.iter().position(|p| p.name == name) {
            return Some(port);
        }
        let is_free = |p: &&str| !parsed.inputs.iter().any(|i| i.name.value == **p);
        let free: Vec<&str> = ports.iter().map(|p| p.name).filter(is_free).collect();
        let near = if self.findings.is_full() { None } else { nearest(name, free.iter().copied()) };
        let help = match near {
            Some(near) => format!("did you mean `{near}`?"),
            None => listed(ports.iter().map(|p| p.name), "inputs"),
        };
        self.findings.say(
            input.name.span,
            Code::UnknownPort,
            format!("`{}` ({}) has no input {}", parsed.name.value, stage.kind.name, shown(name)),
            help,
        );
        ports.iter().position(|p| Some(p.name) == near)
    }

    /// The output that a topic names.
    fn output(&self, topic: &Marked<Topic>) -> Option<(usize, usize, &'static SampleKind)> {
        let Topic { operator, port } = &topic.value;
        let Some(&number) = self.numbers.get(operator.value.as_str()) else {
            let names = self.document.operators.iter().map(|o| o.name.value.as_str());
            self.findings.say(
                operator.span,
                Code::UnknownOperator,
                format!("there is no operator {}", shown(&operator.value)),
                match self.registry.get(&operator.value) {
                    Some(stage) => add(stage),
                    None => suggestion(&operator.value, names, "operators", self.findings),
                },
            );
            return None;
        };
        let stage = self.stages[number].as_ref()?;
        let outputs = stage.kind.outputs;
        if port.value == TIMING && !stage.laps.is_empty() {
            self.findings.say(
                port.span,
                Code::Measured,
                format!(
                    "`{}.{TIMING}` is measured, and differs from run to run: what an operator does with it could not be \
                     replayed",
                    operator.value
                ),
                format!("remove it; `stillpoint echo {}.{TIMING}` shows it, and every live session keeps it", operator.value),
            );
            return None;
        }
        let Some(output) = outputs.iter().position(|o| o.name == port.value) else {
            self.findings.say(
                port.span,
                Code::UnknownPort,
                format!("`{}` ({}) has no output {}", operator.value, stage.kind.name, shown(&port.value)),
                suggestion(&port.value, outputs.iter().map(|o| o.name), "outputs", self.findings),
            );
            return None;
        };
        Some((number, output, outputs[output].sample))
    }

    fn mismatch(
        &self,
        operator: usize,
        input: &str,
        expected: &'static SampleKind,
        from: &Marked<Topic>,
        found: &'static SampleKind,
    ) {
        let topic = format!("{}.{}", from.value.operator.value, from.value.port.value);
        let message = if expected.name == found.name {
            format!(
                "`{input}` takes {expected}, but `{topic}` sends {found}: their layouts or units differ",
                expected = expected.type_name(),
                found = found.type_name()
            )
        } else {
            format!(
                "`{input}` takes {}, but `{topic}` sends {}",
                with_article(expected.name),
                with_article(found.name)
            )
        };
        let topics = self.topics_of(expected, operator);
        let help = match topics.as_slice() {
            [] => format!("no operator of this pipeline sends {}: add one", with_article(expected.name)),
            some => {
                let quoted: Vec<String> = some.iter().map(|t| format!("`{t}`")).collect();
                let words: Vec<&str> = quoted.iter().map(String::as_str).collect();
                format!("connect {}", super::quantity::or(&words))
            }
        };
        self.findings.say(from.span, Code::TypeMismatch, message, help);
    }

    /// Topics of a type, the first few, without those of the operator that asks.
    fn topics_of(&self, sample: &'static SampleKind, but: usize) -> Vec<String> {
        if self.findings.is_full() {
            return Vec::new();
        }
        let operators =
            self.document.operators.iter().zip(self.stages).enumerate().filter(|(i, _)| *i != but);
        operators
            .filter_map(|(_, (o, stage))| stage.as_ref().map(|s| (o, s)))
            .flat_map(|(o, s)| s.kind.outputs.iter().map(move |p| (o, p)))
            .filter(|(_, p)| *p.sample == *sample)
            .map(|(o, p)| format!("{}.{}", o.name.value, p.name))
            .take(LISTED)
            .collect()
    }
}

/// How an operator that is called like its kind is added.
fn add(stage: &Stage) -> String {
    let name = stage.kind.name;
    let every = if stage.kind.timer == Timer::Required { ", every: 20 ms" } else { "" };
    format!("add it to `operators`: `{name}: {{ use: {name}{every} }}`")
}

/// A type with its article.
pub fn with_article(name: &str) -> String {
    let vowel = name.starts_with(['A', 'E', 'I', 'O', 'U']);
    if name.ends_with('s') { name.to_owned() } else { format!("{} {name}", if vowel { "an" } else { "a" }) }
}
