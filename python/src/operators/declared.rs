//! What a class declares, as the checker and the executors need it.
//!
//! A kind lives as long as the process, as the kinds of Rust do.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde::Deserialize;
use serde_json::{Map, Value};
use stillpoint_operator::params::{
    CheckedParams, Names, ParamField, ParamReader, ParamType, ParamValue, Presence, verify,
};
use stillpoint_operator::{
    DescribeError, FrameRule, Input, Kind, Output, Policy, Role, SetupError, Stage, TIMING, Timer,
};
use stillpoint_samples::by_name;

use super::operator::PythonOperator;

/// Names of topics that an operator has without declaring them.
const RESERVED: [&str; 4] = [TIMING, "journal", "inbox", "settings"];

/// A class with what it declares.
pub struct Declared {
    /// Name of the kind: `ops/speed.py:Speed`.
    pub name: &'static str,
    kind: Kind,
    fields: &'static [ParamField],
    capacities: Vec<Capacity>,
    /// The sources that it reads.
    pub sources: Vec<String>,
}

/// Checked parameters of an operator of a class.
pub struct Values {
    /// The class.
    pub declared: &'static Declared,
    /// By name, in SI units.
    pub values: Map<String, Value>,
}

/// The most elements of a sample of an output.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
enum Capacity {
    Elements(usize),
    Param(String),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Described {
    about: String,
    timer: String,
    inputs: Vec<DescribedInput>,
    outputs: Vec<DescribedOutput>,
    params: Vec<DescribedParam>,
    sources: Vec<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DescribedInput {
    name: String,
    sample: String,
    /// Samples that wait; none for the newest alone.
    queue: Option<u32>,
    required: bool,
    about: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DescribedOutput {
    name: String,
    sample: String,
    /// The input whose frame it has.
    frame_of: Option<String>,
    /// Whether the config names its frame.
    framed: bool,
    capacity: Capacity,
    about: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DescribedParam {
    name: String,
    #[serde(rename = "type")]
    kind: String,
    unit: String,
    default: Option<String>,
    min: Option<String>,
    max: Option<String>,
    choices: Vec<String>,
    about: String,
}

fn leak(text: &str) -> &'static str {
    Box::leak(text.to_owned().into_boxed_str())
}

fn leak_all<T>(all: Vec<T>) -> &'static [T] {
    Box::leak(all.into_boxed_slice())
}

impl Declared {
    /// Out of the description of a class as JSON, with the sources that it reads; or what is wrong with the class.
    pub fn of(name: &str, json: &str) -> Result<(&'static Self, Vec<String>), String> {
        let value: Value = serde_json::from_str(json).map_err(|e| e.to_string())?;
        if let Some(wrong) = value.get("fault").and_then(Value::as_str) {
            return Err(wrong.to_owned());
        }
        let found: Described = serde_json::from_value(value).map_err(|e| format!("`{name}`: {e}"))?;
        let sample = |port: &str, sample: &str| {
            by_name(sample).ok_or_else(|| {
                let all: Vec<&str> = stillpoint_samples::all().iter().map(|kind| kind.name).collect();
                format!(
                    "`{name}`: there is no sample {sample}, which `{port}` names (allowed: {})",
                    all.join(", ")
                )
            })
        };
        let mut inputs = Vec::new();
        for input in &found.inputs {
            inputs.push(Input {
                name: leak(&input.name),
                sample: sample(&input.name, &input.sample)?,
                policy: input.queue.map_or(Policy::Latest, Policy::Queue),
                required: input.required,
                about: leak(&input.about),
            });
        }
        let mut outputs = Vec::new();
        for output in &found.outputs {
            if RESERVED.contains(&output.name.as_str()) {
                return Err(format!(
                    "`{name}`: give the output `{}` another name: every operator may have it",
                    output.name
                ));
            }
            let frame = match (&output.frame_of, output.framed) {
                (Some(input), _) if !found.inputs.iter().any(|i| i.name == *input) => {
                    return Err(format!(
                        "`{name}`: the output `{}` has the frame of `{input}`, which is not an input",
                        output.name
                    ));
                }
                (Some(input), _) => FrameRule::SameAs(leak(input)),
                (None, true) => FrameRule::Key,
                (None, false) => FrameRule::None,
            };
            let sample = sample(&output.name, &output.sample)?;
            outputs.push(Output { name: leak(&output.name), sample, frame, about: leak(&output.about) });
        }
        let fields: Result<Vec<ParamField>, String> = found
            .params
            .iter()
            .map(|param| param.field().map_err(|why| format!("`{name}`: {why}")))
            .collect();
        let name = leak(name);
        let timer = match found.timer.as_str() {
            "no" => Timer::No,
            "required" => Timer::Required,
            _ => Timer::Optional,
        };
        let kind = Kind {
            name,
            about: leak(&found.about),
            role: Role::Operator,
            inputs: leak_all(inputs),
            outputs: leak_all(outputs),
            timer,
        };
        let capacities = found.outputs.into_iter().map(|output| output.capacity).collect();
        let sources = found.sources.clone();
        let declared = Self { name, kind, fields: leak_all(fields?), capacities, sources: found.sources };
        Ok((Box::leak(Box::new(declared)), sources))
    }

    /// The kind in the form of all kinds.
    ///
    /// # Errors
    /// The declared parameters contradict themselves.
    pub fn stage(&'static self) -> Result<Stage, DescribeError> {
        let stage = Stage {
            kind: self.kind,
            laps: &[],
            wire: None,
            fields: self.fields,
            described: Some(self),
            read,
            validate: |_| Ok(()),
            validate_period: |_, _| Ok(()),
            validate_input: |_, _, _| Ok(()),
            check_files: |_, _| Ok(()),
            cut_files: |_, _| Ok(BTreeMap::new()),
            remarks: |_, _| Vec::new(),
            listens: |_| None,
            capacities,
            subscriptions: |_| Vec::new(),
            finishes: |_| false,
            build: |checked, setup| {
                let values = values(checked).ok_or_else(|| SetupError(OTHER.to_owned()))?;
                Ok(Box::new(PythonOperator::new(values, setup)?))
            },
        };
        verify(&stage).map_err(|e| DescribeError {
            reason: e.to_string(),
            help: "correct the declaration of the parameter".to_owned(),
        })?;
        Ok(stage)
    }

    /// The input ports.
    pub fn inputs(&self) -> &'static [Input] {
        self.kind.inputs
    }
}

const OTHER: &str = "the parameters are those of another kind: check the pipeline again";

fn values(checked: &CheckedParams) -> Option<&Values> {
    checked.value.downcast_ref::<Values>()
}

fn read(stage: &Stage, reader: &mut ParamReader<'_>) -> Option<CheckedParams> {
    let declared = stage.described?.downcast_ref::<Declared>()?;
    reader.open(declared.fields);
    let mut values = Map::new();
    let mut is_whole = true;
    for field in declared.fields {
        let value = match field.ty {
            ParamType::Number => reader.field::<f64>(field).map(|v| v.resolved()),
            ParamType::Integer { .. } => reader.field::<i64>(field).map(|v| v.resolved()),
            ParamType::Switch => reader.field::<bool>(field).map(|v| v.resolved()),
            _ => reader.field::<String>(field).map(|v| v.resolved()),
        };
        match value {
            Some(value) => _ = values.insert(field.name.to_owned(), value),
            None => is_whole = false,
        }
    }
    declared.sources.iter().for_each(|source| reader.reads(source));
    reader.keep(Value::Object(values.clone()));
    is_whole.then(|| CheckedParams {
        value: Arc::new(Values { declared, values }),
        resolved: reader.resolved(),
        given: reader.given().into(),
    })
}

fn capacities(checked: &CheckedParams) -> Vec<usize> {
    let Some(Values { declared, values }) = values(checked) else { return Vec::new() };
    let of = |capacity: &Capacity| match capacity {
        Capacity::Elements(count) => *count,
        Capacity::Param(name) => {
            values.get(name).and_then(Value::as_u64).and_then(|n| usize::try_from(n).ok()).unwrap_or(1)
        }
    };
    declared.capacities.iter().map(of).collect()
}

impl DescribedParam {
    fn field(&self) -> Result<ParamField, String> {
        let ty = match self.kind.as_str() {
            "number" => f64::TYPE,
            "integer" => i64::TYPE,
            "switch" => bool::TYPE,
            "text" => String::TYPE,
            other => {
                return Err(format!(
                    "the parameter `{}` has the type {other} (allowed: number, integer, switch, text)",
                    self.name
                ));
            }
        };
        let choices: Vec<&'static str> = self.choices.iter().map(|choice| leak(choice)).collect();
        Ok(ParamField {
            about: leak(&self.about),
            presence: Presence::Required,
            unit: leak(&self.unit),
            default: self.default.as_deref().map(leak),
            min: self.min.as_deref().map(leak),
            max: self.max.as_deref().map(leak),
            choices: leak_all(choices),
            names: Names::Nothing,
            ..ParamField::new(leak(&self.name), ty)
        })
    }
}
