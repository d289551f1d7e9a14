//! JSON Schema of a pipeline, for editors: made from the kinds and their parameters.

use serde_json::{Map, Value, json};

use super::quantity::or;
use super::units::find;
use super::{
    contracts as bounds, document, frames, host_section, includes, inputs, links, operators, processes,
    record, ros2_section,
};
use crate::hosts::MAIN;
use crate::operator::{FrameRule, Kind, Policy, Registry, Stage, Timer};
use crate::params::{ParamField, ParamType, Presence};

/// A number as a quantity has it.
const NUMBER: &str = r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?";
/// A name of an operator, a process or a frame.
const NAME: &str = "^[a-z][a-z0-9_]{0,39}$";
const TOPIC: &str = r"^[a-z][a-z0-9_]{0,39}\.[a-z][a-z0-9_]*$";

/// The schema of a pipeline whose operators are of these kinds (JSON Schema, draft 2020-12).
pub fn schema(registry: &Registry) -> Value {
    let kinds: Vec<Value> =
        registry.iter().map(|s| json!({ "const": s.kind.name, "description": s.kind.about })).collect();
    let by_kind: Vec<Value> = registry.iter().map(when_kind).collect();
    let mut operator = closed(operators::KEYS, &["use"], |key| match key {
        "use" => json!({
            "description": "Kind of the operator.",
            "oneOf": kinds.iter().cloned().chain([in_program(), in_python()]).collect::<Vec<_>>(),
        }),
        "params" => json!({ "type": "object", "description": "Its parameters." }),
        "inputs" => json!({ "type": "object", "description": "Where its samples come from." }),
        "every" => quantity("ns", "Period of its timer."),
        "frame" => json!({ "type": "string", "description": "Frame of its samples, a name of `frames`." }),
        "latency" => quantity("ns", "Time that the simulated executor charges for a step."),
        "start_within" => quantity("ns", "Longest time from a tick of its timer to the activation."),
        _ => quantity("ns", "Longest step, after which its process is ended."),
    });
    set(&mut operator, "allOf", Value::Array(by_kind));
    let mut file = closed(document::KEYS, &["stillpoint"], |key| match key {
        "stillpoint" => json!({ "const": document::VERSION as i64, "description": "Version of the format." }),
        "name" => {
            json!({ "type": "string", "pattern": "^[a-z][a-z0-9_-]{0,39}$", "description": "Name of the pipeline." })
        }
        "seed" => {
            json!({ "type": "integer", "minimum": 0, "default": 1, "description": "Seed of all random numbers." })
        }
        "include" => include(),
        "parameters" => parameters(),
        "frames" => named("Frames by their names.", frame()),
        "operators" => named("Operators by their names.", json!({ "$ref": "#/$defs/operator" })),
        "links" => links(),
        "hosts" => hosts(),
        "ros2" => ros2(),
        "processes" => named("Which operators share a process; each of the rest has its own.", process()),
        "contracts" => contracts(),
        _ => recorded(),
    });
    // A file that others include has no name of its own.
    let whole = [json!({ "required": ["name", "operators"] }), json!({ "required": ["name", "include"] })];
    let part = json!({ "not": { "required": ["name"] } });
    set(&mut file, "anyOf", whole.into_iter().chain([part]).collect());
    set(&mut file, "$schema", json!("https://json-schema.org/draft/2020-12/schema"));
    set(&mut file, "title", json!("stillpoint pipeline"));
    set(&mut file, "$defs", json!({ "operator": operator, "input": input() }));
    file
}

fn set(schema: &mut Value, key: &str, value: Value) {
    if let Value::Object(map) = schema {
        map.insert(key.to_owned(), value);
    }
}

/// A mapping with these keys and no other.
fn closed(keys: &[&str], required: &[&str], schema_of: impl Fn(&str) -> Value) -> Value {
    let properties: Map<String, Value> = keys.iter().map(|k| ((*k).to_owned(), schema_of(k))).collect();
    json!({ "type": "object", "properties": properties, "required": required, "additionalProperties": false })
}

fn named(about: &str, item: Value) -> Value {
    json!({
        "type": "object", "description": about,
        "propertyNames": { "pattern": NAME }, "additionalProperties": item,
    })
}

/// A number with one of the units of what `unit` measures.
fn quantity(unit: &str, about: &str) -> Value {
    let units: Vec<&str> =
        find(unit).map(|(d, _)| d.units.iter().map(|u| u.symbol).collect()).unwrap_or_default();
    let name = find(unit).map_or("a quantity", |(d, _)| d.name);
    let alternatives: Vec<String> = units.iter().map(|u| u.replace('^', r"\^").replace('*', r"\*")).collect();
    json!({
        "type": "string",
        "pattern": format!(r"^\s*{NUMBER}\s*({})\s*$", alternatives.join("|")),
        "description": format!("{about} Write {name} in {}.", or(&units)).trim(),
    })
}

/// A kind that a program has.
fn in_program() -> Value {
    let mut program = closed(operators::PROGRAM_KEYS, operators::PROGRAM_KEYS, |key| match key {
        "program" => {
            json!({ "type": "string", "description": "Path of the program, from the folder of this file." })
        }
        _ => json!({ "type": "string", "description": "Name of the kind in the program." }),
    });
    set(&mut program, "description", json!("A kind that a program of its own has."));
    program
}

/// A kind that is a class in Python.
fn in_python() -> Value {
    json!({ "type": "string", "pattern": r"\.py:\w+$", "description": "A class in Python, `ops/speed.py:Speed`." })
}

fn include() -> Value {
    let path =
        json!({ "type": "string", "description": "Path of a pipeline file, from the folder of this one." });
    let detailed = closed(includes::KEYS, &["file"], |key| match key {
        "file" => path.clone(),
        _ => {
            json!({ "type": "object", "description": "Values for parameters of that file.", "propertyNames": { "pattern": NAME } })
        }
    });
    let one = json!({ "oneOf": [path, detailed] });
    let mut include = json!({ "oneOf": [path, detailed, { "type": "array", "items": one }] });
    set(&mut include, "description", json!("Files whose sections stand before those of this one."));
    include
}

fn parameters() -> Value {
    let place =
        json!({ "type": "string", "description": "Place of a value, as for `--set`: `operator.param`." });
    named(
        "Places that a file which includes this one may give values for, by name.",
        json!({ "oneOf": [place, { "type": "array", "items": place }] }),
    )
}

fn frame() -> Value {
    let triple = |unit, about| json!({ "type": "array", "items": quantity(unit, about), "minItems": 3, "maxItems": 3 });
    closed(frames::KEYS, &["parent", "at"], |key| match key {
        "parent" => {
            json!({ "type": "string", "pattern": NAME, "description": "Frame that it is placed in." })
        }
        "at" => triple("m", "Its origin in the parent."),
        "rotation" => triple("rad", "Rotation about the fixed x, then y, then z axis of the parent."),
        "measured" => {
            json!({ "type": "string", "pattern": r"^\d{4}-\d{2}-\d{2}$", "description": "Day of the measurement." })
        }
        _ => quantity("m", "Residual of the measurement."),
    })
}

fn input() -> Value {
    let topic = json!({ "type": "string", "pattern": TOPIC, "description": "`operator.port`" });
    let detailed = closed(inputs::KEYS, &["from"], |key| match key {
        "from" => topic.clone(),
        "latest" => {
            json!({ "const": true, "description": "The newest sample, held until there is a newer one." })
        }
        "queue" => json!({
            "type": "integer", "minimum": 1, "maximum": inputs::LONGEST_QUEUE,
            "description": "Every sample in order; the oldest goes when more than this many wait.",
        }),
        "delay" => quantity("ns", "A sample is seen this long after its stamp."),
        "max_age" => quantity("ns", "How old a sample may be when it is taken, since its acquisition."),
        "else" => json!({
            "enum": ["count", "skip", "hold", "fault"],
            "description": "What the operator does about an older sample: take it and count it, not see it, do nothing, or fail.",
        }),
        _ => {
            let mut sync = closed(&["with", "within"], &["with", "within"], |key| match key {
                "with" => json!({ "type": "array", "items": { "type": "string" }, "minItems": 1 }),
                _ => quantity("ns", "Greatest distance of the origins."),
            });
            set(&mut sync, "description", json!("One sample each from these inputs, in step."));
            sync
        }
    });
    json!({ "oneOf": [topic, detailed] })
}

fn contracts() -> Value {
    let contract = closed(bounds::KEYS, &["path", "within"], |key| match key {
        "path" => json!({
            "type": "string", "pattern": format!(r"^\s*{}\s*->\s*{}\s*$", &TOPIC[1..TOPIC.len() - 1], &TOPIC[1..TOPIC.len() - 1]),
            "description": "Two topics, `operator.port -> operator.port`.",
        }),
        "within" => {
            quantity("ns", "Longest time from the acquisition at the start to the sending at the end.")
        }
        "share" => json!({
            "type": "string", "pattern": format!(r"^\s*{NUMBER}\s*%\s*$"), "default": "100 %",
            "description": "Share of the samples that keep the bound.",
        }),
        _ => {
            json!({ "enum": ["count", "fault"], "default": "count", "description": "Whether a broken contract is a failure of the run." })
        }
    });
    json!({ "type": "array", "description": "Bounds of the time that samples take.", "items": contract })
}

fn links() -> Value {
    let link = closed(links::KEYS, &[], |key| match key {
        "udp" => json!({
            "type": "string", "pattern": r"^\S+:[0-9]{1,5}$",
            "description": "Address and port of the far end, which listens there for datagrams in a live run.",
        }),
        _ => quantity("ns", "How long a sample is on its way where the run is not live."),
    });
    json!({
        "type": "object", "description": "Topics that leave the machine's memory, and how.",
        "propertyNames": { "pattern": TOPIC }, "additionalProperties": link,
    })
}

fn hosts() -> Value {
    let endpoint = json!({ "type": "string", "pattern": r"^(tcp|tls)/\S+:[0-9]{1,5}$" });
    let host = closed(host_section::KEYS, &[], |key| match key {
        "takes" => json!({
            "type": "array", "items": { "type": "string", "pattern": TOPIC },
            "description": "Topics of other hosts that it takes and records, besides those that its operators take.",
        }),
        "tls" => {
            let mut files = closed(host_section::TLS_KEYS, host_section::TLS_KEYS, |key| {
                json!({
                    "type": "string",
                    "description": match key {
                        "certificate" => "Certificate of the host, PEM, in a file next to the pipeline.",
                        "key" => "Key of the certificate, PEM; only its owner may read the file.",
                        _ => "Certificate of the authority that signs the certificates of all hosts, PEM.",
                    },
                })
            });
            files["description"] =
                "The certificate of the host; with it, all its endpoints are `tls/...`.".into();
            files
        }
        _ => json!({
            "description": match key {
                "listen" => "Endpoint at which others reach it; the next port is used, too.",
                "connect" => "Endpoint of a host that listens.",
                _ => "Endpoint of a router, in place of the other two.",
            },
            "oneOf": [endpoint, { "type": "array", "items": endpoint }],
        }),
    });
    named("The hosts that exchange samples over the network.", host)
}

fn ros2() -> Value {
    let publication = closed(ros2_section::PUBLICATION_KEYS, &[], |key| match key {
        "topic" => json!({
            "type": "string", "pattern": "^(/[A-Za-z_][A-Za-z0-9_]*)+$",
            "description": "Topic of ROS 2. Next to that of a depth image, `camera_info` is published.",
        }),
        "type" => json!({
            "enum": ["PoseStamped", "PoseWithCovarianceStamped", "PointCloud2", "Image"],
            "description": "Type of the message, where there are several that say the sample.",
        }),
        _ => json!({ "type": "string", "description": "Frame that the pose places, on `/tf`." }),
    });
    let mut section = closed(ros2_section::KEYS, &["connect"], |key| match key {
        "connect" => json!({
            "type": "string", "pattern": r"^tcp/[A-Za-z0-9.\-_:\[\]]+:\d+$",
            "description": "Endpoint of the router of ROS 2 (`rmw_zenohd`).",
        }),
        "domain" => json!({
            "type": "integer", "minimum": 0, "maximum": stillpoint_ros2::LARGEST_DOMAIN, "default": 0,
            "description": "`ROS_DOMAIN_ID`.",
        }),
        _ => json!({
            "type": "object", "description": "What is published of which topic.",
            "propertyNames": { "pattern": TOPIC }, "additionalProperties": publication,
        }),
    });
    set(&mut section, "description", json!("How the pipeline takes part in ROS 2."));
    section
}

fn process() -> Value {
    let members = json!({ "type": "array", "items": { "type": "string" }, "minItems": 1 });
    let restart = closed(&["limit", "backoff"], &[], |key| match key {
        "limit" => json!({ "type": "integer", "minimum": 1, "maximum": 1000, "default": 5 }),
        _ => quantity("ns", "Wait before the first restart; it doubles each time."),
    });
    let detailed = closed(processes::KEYS, &["operators"], |key| match key {
        "operators" => members.clone(),
        "restart" => json!({
            "description": "What happens when the process ends without being asked.",
            "oneOf": [{ "enum": ["never", "on-fault"] }, restart],
        }),
        "core" => json!({
            "type": "integer", "minimum": 0, "maximum": processes::MOST_CORES - 1,
            "description": "Core that it is bound to.",
        }),
        "host" => json!({
            "type": "string", "default": MAIN,
            "description": "Where it runs when the pipeline is run in parts (`run --host`, `rig`).",
        }),
        "outlives" => quantity("ns", "How long it goes on after its supervisor died, at most 10 s."),
        _ => json!({
            "type": "string", "pattern": "^(normal|fifo [1-9][0-9]?( if allowed)?)$",
            "description": "`normal`, `fifo N`, or `fifo N if allowed`, with N from 1 to 99.",
        }),
    });
    json!({ "oneOf": [members, detailed] })
}

fn recorded() -> Value {
    let topics = json!({
        "description": "Topics that a session keeps: replay makes the rest again.", "default": "sources",
        "oneOf": [
            { "enum": ["sources", "all"] },
            { "type": "array", "items": { "type": "string", "pattern": TOPIC } },
        ],
    });
    closed(record::KEYS, &["topics"], |_| topics.clone())
}

/// What holds for an operator of one kind.
fn when_kind(stage: &Stage) -> Value {
    let Kind { name, inputs, outputs, timer, .. } = stage.kind;
    let mut then = Map::new();
    let mut required = Vec::new();
    then.insert("params".into(), group(stage.fields, stage.kind.about));
    if stage.fields.iter().any(ParamField::is_required) {
        required.push("params");
    }
    let ports: Map<String, Value> = inputs
        .iter()
        .map(|i| {
            let policy = match i.policy {
                Policy::Queue(n) => format!("a queue of {n}"),
                Policy::Latest => "the latest".into(),
                Policy::Sync { within } => format!("in step within {} ns", within),
            };
            let about = format!("{} Takes {}; {policy} by default.", i.about, i.sample.name);
            (i.name.to_owned(), json!({ "$ref": "#/$defs/input", "description": about }))
        })
        .collect();
    let needed: Vec<&str> = inputs.iter().filter(|i| i.required).map(|i| i.name).collect();
    if !needed.is_empty() {
        required.push("inputs");
    }
    then.insert(
        "inputs".into(),
        json!({ "properties": ports, "required": needed, "additionalProperties": false }),
    );
    match timer {
        Timer::Required => required.push("every"),
        Timer::No => {
            then.insert("every".into(), json!(false));
        }
        Timer::Optional => {}
    }
    if outputs.iter().any(|o| o.frame == FrameRule::Key) {
        required.push("frame");
    } else if !outputs.iter().any(|o| matches!(o.frame, FrameRule::KeyOr(_))) {
        then.insert("frame".into(), json!(false));
    }
    json!({
        "if": { "properties": { "use": { "const": name } }, "required": ["use"] },
        "then": { "properties": then, "required": required },
    })
}

fn group(fields: &[ParamField], about: &str) -> Value {
    let properties: Map<String, Value> = fields.iter().map(|f| (f.name.to_owned(), param(f))).collect();
    let required: Vec<&str> = fields.iter().filter(|f| f.is_required()).map(|f| f.name).collect();
    json!({
        "type": "object", "description": about,
        "properties": properties, "required": required, "additionalProperties": false,
    })
}

fn param(field: &ParamField) -> Value {
    let mut about = field.about.to_owned();
    if let Some(range) = field.range() {
        about = format!("{about} Must be {range}.");
    }
    let mut schema = typed(field, field.ty);
    if let Some(text) = schema.get("description").and_then(Value::as_str) {
        about = format!("{about} {}", text.trim());
    }
    if field.presence == Presence::Optional {
        schema = json!({ "anyOf": [schema, { "type": "null" }] });
    }
    set(&mut schema, "description", json!(about.trim()));
    if let Some(default) = field.default {
        let is_text = !field.unit.is_empty() || matches!(field.ty, ParamType::Text | ParamType::Choice(_));
        let value = if is_text { None } else { serde_json::from_str(default).ok() };
        set(&mut schema, "default", value.unwrap_or_else(|| json!(default)));
    }
    schema
}

fn typed(field: &ParamField, ty: ParamType) -> Value {
    let bound = |text: Option<&str>| text.and_then(|t| serde_json::from_str::<Value>(t).ok());
    let mut schema = match ty {
        ParamType::Number | ParamType::Integer { .. } if !field.unit.is_empty() => {
            return quantity(field.unit, "");
        }
        ParamType::Number => json!({ "type": "number" }),
        ParamType::Integer { least, .. } if least >= 0 => json!({ "type": "integer", "minimum": 0 }),
        ParamType::Integer { .. } => json!({ "type": "integer" }),
        ParamType::Switch => json!({ "type": "boolean" }),
        ParamType::Text if field.choices.is_empty() => json!({ "type": "string" }),
        ParamType::Text | ParamType::Choice(_) => {
            let names = if let ParamType::Choice(names) = ty { names } else { field.choices };
            json!({ "enum": names })
        }
        ParamType::List { of, len: Some(len) } => {
            json!({ "type": "array", "items": typed(field, *of), "minItems": len, "maxItems": len })
        }
        ParamType::List { of, len: None } => json!({ "type": "array", "items": typed(field, *of) }),
        ParamType::Group(fields) => group(fields, ""),
    };
    if matches!(ty, ParamType::Number | ParamType::Integer { .. }) {
        for (key, text) in [("minimum", field.min), ("exclusiveMinimum", field.above), ("maximum", field.max)]
        {
            if let Some(value) = bound(text) {
                set(&mut schema, key, value);
            }
        }
    }
    schema
}
