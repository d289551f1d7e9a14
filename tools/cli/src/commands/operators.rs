//! `stillpoint operators`

use clap::Args;
use serde_json::{Value, json};
use stillpoint_operator::params::{ParamField, ParamType};
use stillpoint_operator::{Registry, Role, Stage, Timer};
use stillpoint_pipeline::config::near::nearest;
use stillpoint_pipeline::config::reference::{frame_of, policy_of, reference, reference_of, type_of};

use crate::exit::{Ended, Exit, Failure, print_json};

/// List the kinds of operators, or describe one.
#[derive(Args)]
pub struct Operators {
    /// The kind, such as `segment.face`.
    kind: Option<String>,
    /// Print the whole reference page.
    #[arg(long)]
    all: bool,
    /// Print the ports and parameters of each kind as JSON.
    #[arg(long, conflicts_with = "all")]
    json: bool,
}

impl Operators {
    /// Executes the subcommand.
    pub fn execute(&self, registry: &Registry) -> Ended {
        match &self.kind {
            Some(name) => match registry.get(name) {
                Some(stage) if self.json => print_json(&described(stage))?,
                Some(stage) => out!("{}", reference_of(stage)),
                None => {
                    let near = nearest(name, registry.iter().map(|s| s.kind.name));
                    let help = near.map_or_else(String::new, |n| format!("; did you mean {n}?"));
                    return Err(Failure::wrong(format!("there is no kind of operator `{name}`{help}")));
                }
            },
            None if self.json => print_json(&registry.iter().map(described).collect::<Vec<_>>())?,
            None if self.all => out!("{}", reference(registry)),
            None => {
                for stage in registry.iter() {
                    outln!("{:<18} {}", stage.kind.name, stage.kind.about);
                }
            }
        }
        Ok(Exit::Done)
    }
}

/// A kind of operator as JSON: the contents of the reference page.
fn described(stage: &Stage) -> Value {
    let kind = &stage.kind;
    let inputs = kind.inputs.iter().map(|i| {
        json!({
            "name": i.name, "takes": i.sample.name, "consumed": policy_of(i.policy), "required": i.required,
            "about": i.about,
        })
    });
    let outputs = kind.outputs.iter().map(
        |o| json!({ "name": o.name, "sends": o.sample.name, "frame": frame_of(o.frame), "about": o.about }),
    );
    json!({
        "kind": kind.name,
        "about": kind.about,
        "role": match kind.role {
            Role::Operator => "operator",
            Role::Source => "source",
        },
        "timer": match kind.timer {
            Timer::No => "no",
            Timer::Optional => "optional",
            Timer::Required => "required",
        },
        "inputs": inputs.collect::<Vec<_>>(),
        "outputs": outputs.collect::<Vec<_>>(),
        "params": stage.fields.iter().map(param).collect::<Vec<_>>(),
        "laps": stage.laps,
    })
}

/// A parameter; a group holds its own parameters.
fn param(field: &ParamField) -> Value {
    let nested = match field.ty {
        ParamType::Group(fields) => fields,
        _ => &[],
    };
    json!({
        "name": field.name, "type": type_of(field), "unit": field.unit, "required": field.is_required(),
        "default": field.default, "min": field.min, "above": field.above, "max": field.max,
        "choices": field.choices(), "live": field.is_live, "about": field.about,
        "params": nested.iter().map(param).collect::<Vec<_>>(),
    })
}
