//! Kinds of operators as JSON, and back. A kind that was read lives as long as the process, as the kinds of a list do.

use serde_json::{Map, Value, json};
use stillpoint_samples::{SampleKind, by_name};

use super::PROTOCOL;
use crate::kind::{FrameRule, Input, Kind, Output, Policy, Role, Timer};
use crate::params::{Names, ParamField, ParamType, Presence};
use crate::stage::Stage;

/// A kind as a program describes it.
#[derive(Clone, Copy, Debug)]
pub struct Described {
    /// Name, ports and purpose.
    pub kind: Kind,
    /// Parameters with defaults, units and ranges.
    pub fields: &'static [ParamField],
}

/// Why a description cannot be used.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{0}")]
pub struct DescriptionError(pub String);

/// The kinds of a list.
pub fn to_json(stages: &[Stage]) -> Value {
    json!({
        "protocol": PROTOCOL,
        "stillpoint": env!("CARGO_PKG_VERSION"),
        "kinds": stages.iter().map(|stage| kind(&stage.kind, stage.fields)).collect::<Vec<_>>(),
    })
}

fn kind(kind: &Kind, fields: &[ParamField]) -> Value {
    json!({
        "name": kind.name,
        "about": kind.about,
        "role": match kind.role { Role::Operator => "operator", Role::Source => "source" },
        "timer": match kind.timer { Timer::No => "no", Timer::Optional => "optional", Timer::Required => "required" },
        "inputs": kind.inputs.iter().map(input).collect::<Vec<_>>(),
        "outputs": kind.outputs.iter().map(output).collect::<Vec<_>>(),
        "params": fields.iter().map(field).collect::<Vec<_>>(),
    })
}

fn input(input: &Input) -> Value {
    let policy = match input.policy {
        Policy::Queue(count) => json!({ "queue": count }),
        Policy::Latest => json!("latest"),
        Policy::Sync { within } => json!({ "sync": within }),
    };
    json!({
        "name": input.name, "sample": input.sample.type_name(), "policy": policy, "required": input.required,
        "about": input.about,
    })
}

fn output(output: &Output) -> Value {
    let frame = match output.frame {
        FrameRule::None => Value::Null,
        FrameRule::Key => json!("key"),
        FrameRule::KeyOr(input) => json!({ "key_or": input }),
        FrameRule::SameAs(input) => json!({ "same_as": input }),
        FrameRule::Named(name) => json!({ "named": name }),
    };
    json!({ "name": output.name, "sample": output.sample.type_name(), "frame": frame, "about": output.about })
}

fn field(field: &ParamField) -> Value {
    json!({
        "name": field.name,
        "about": field.about,
        "type": param_type(field.ty),
        "presence": match field.presence {
            Presence::Required => "required",
            Presence::Optional => "optional",
            Presence::Group => "group",
        },
        "unit": field.unit,
        "default": field.default,
        "min": field.min,
        "above": field.above,
        "max": field.max,
        "choices": field.choices,
        "names": match field.names {
            Names::Nothing => Value::Null,
            Names::File => json!("file"),
            Names::Files(pattern) => json!({ "files": pattern }),
        },
        "live": field.is_live,
    })
}

fn param_type(ty: ParamType) -> Value {
    match ty {
        ParamType::Number => json!("number"),
        ParamType::Integer { least, greatest } => {
            json!({ "integer": [least.to_string(), greatest.to_string()] })
        }
        ParamType::Switch => json!("switch"),
        ParamType::Text => json!("text"),
        ParamType::Choice(names) => json!({ "choice": names }),
        ParamType::List { of, len } => json!({ "list": param_type(*of), "length": len }),
        ParamType::Group(fields) => json!({ "group": fields.iter().map(field).collect::<Vec<_>>() }),
    }
}

/// The kinds that a program describes.
///
/// # Errors
/// It speaks another version, or names a sample that this build does not have.
pub fn from_json(value: &Value) -> Result<Vec<Described>, DescriptionError> {
    if value["protocol"].as_u64() != Some(PROTOCOL) {
        return Err(DescriptionError(format!(
            "it was built with another version of stillpoint-operator ({}; this is {})",
            value["stillpoint"].as_str().unwrap_or("unknown"),
            env!("CARGO_PKG_VERSION"),
        )));
    }
    list(value, "kinds")?.iter().map(read_kind).collect()
}

fn read_kind(value: &Value) -> Result<Described, DescriptionError> {
    let name = text(value, "name")?;
    let inputs: Vec<Input> = list(value, "inputs")?.iter().map(read_input).collect::<Result<_, _>>()?;
    let outputs: Vec<Output> = list(value, "outputs")?.iter().map(read_output).collect::<Result<_, _>>()?;
    let kind = Kind {
        name,
        about: text(value, "about")?,
        role: if text(value, "role")? == "source" { Role::Source } else { Role::Operator },
        inputs: inputs.leak(),
        outputs: outputs.leak(),
        timer: match text(value, "timer")? {
            "no" => Timer::No,
            "required" => Timer::Required,
            _ => Timer::Optional,
        },
    };
    Ok(Described { kind, fields: read_fields(value, "params")? })
}

fn read_input(value: &Value) -> Result<Input, DescriptionError> {
    let policy = &value["policy"];
    let queue = policy["queue"].as_u64().and_then(|count| u32::try_from(count).ok());
    let policy = match (queue, policy["sync"].as_u64()) {
        (Some(count), _) => Policy::Queue(count),
        (None, Some(within)) => Policy::Sync { within },
        (None, None) => Policy::Latest,
    };
    Ok(Input {
        name: text(value, "name")?,
        sample: sample(text(value, "sample")?)?,
        policy,
        required: value["required"].as_bool().unwrap_or(true),
        about: text(value, "about")?,
    })
}

fn read_output(value: &Value) -> Result<Output, DescriptionError> {
    let frame = &value["frame"];
    let of = |key: &str| frame[key].as_str().map(leaked);
    let frame = match (of("key_or"), of("same_as"), of("named")) {
        (Some(input), ..) => FrameRule::KeyOr(input),
        (_, Some(input), _) => FrameRule::SameAs(input),
        (.., Some(name)) => FrameRule::Named(name),
        _ if frame == "key" => FrameRule::Key,
        _ => FrameRule::None,
    };
    Ok(Output {
        name: text(value, "name")?,
        sample: sample(text(value, "sample")?)?,
        frame,
        about: text(value, "about")?,
    })
}

/// The sample of a name with its hash.
fn sample(type_name: &str) -> Result<&'static SampleKind, DescriptionError> {
    let name = type_name.split('@').next().unwrap_or_default();
    let kind =
        by_name(name).ok_or_else(|| DescriptionError(format!("there is no sample {name} in this build")))?;
    if kind.type_name() == type_name {
        return Ok(kind);
    }
    Err(DescriptionError(format!(
        "its sample {type_name} has another layout than {} of this build",
        kind.type_name()
    )))
}

fn read_fields(value: &Value, key: &str) -> Result<&'static [ParamField], DescriptionError> {
    let fields: Vec<ParamField> = list(value, key)?.iter().map(read_field).collect::<Result<_, _>>()?;
    Ok(fields.leak())
}

fn read_field(value: &Value) -> Result<ParamField, DescriptionError> {
    let some = |key: &str| value[key].as_str().map(leaked);
    let pattern = value["names"]["files"].as_str().map(leaked);
    Ok(ParamField {
        about: text(value, "about")?,
        presence: match text(value, "presence")? {
            "optional" => Presence::Optional,
            "group" => Presence::Group,
            _ => Presence::Required,
        },
        unit: text(value, "unit")?,
        default: some("default"),
        min: some("min"),
        above: some("above"),
        max: some("max"),
        choices: texts(&value["choices"]),
        names: match (pattern, value["names"].as_str()) {
            (Some(pattern), _) => Names::Files(pattern),
            (None, Some(_)) => Names::File,
            (None, None) => Names::Nothing,
        },
        is_live: value["live"].as_bool().unwrap_or(false),
        ..ParamField::new(text(value, "name")?, read_type(&value["type"])?)
    })
}

fn read_type(value: &Value) -> Result<ParamType, DescriptionError> {
    let none = Map::new();
    let map = value.as_object().unwrap_or(&none);
    let limit =
        |at: usize| map.get("integer").and_then(|all| all[at].as_str()).and_then(|text| text.parse().ok());
    Ok(match value.as_str() {
        Some("number") => ParamType::Number,
        Some("switch") => ParamType::Switch,
        Some("text") => ParamType::Text,
        Some(other) => return Err(DescriptionError(format!("there is no parameter of the type {other}"))),
        None if map.contains_key("integer") => ParamType::Integer {
            least: limit(0).unwrap_or(i128::from(i64::MIN)),
            greatest: limit(1).unwrap_or(i128::from(i64::MAX)),
        },
        None if map.contains_key("choice") => ParamType::Choice(texts(&value["choice"])),
        None if map.contains_key("list") => ParamType::List {
            of: Box::leak(Box::new(read_type(&value["list"])?)),
            len: value["length"].as_u64().and_then(|n| usize::try_from(n).ok()),
        },
        None => ParamType::Group(read_fields(value, "group")?),
    })
}

fn list<'v>(value: &'v Value, key: &str) -> Result<&'v [Value], DescriptionError> {
    value[key]
        .as_array()
        .map(Vec::as_slice)
        .ok_or_else(|| DescriptionError(format!("its description has no `{key}`")))
}

fn text(value: &Value, key: &str) -> Result<&'static str, DescriptionError> {
    value[key].as_str().map(leaked).ok_or_else(|| DescriptionError(format!("its description has no `{key}`")))
}

fn texts(value: &Value) -> &'static [&'static str] {
    value.as_array().into_iter().flatten().filter_map(Value::as_str).map(leaked).collect::<Vec<_>>().leak()
}

fn leaked(text: &str) -> &'static str {
    text.to_owned().leak()
}
