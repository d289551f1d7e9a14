//! The reference page of kinds of operators, as Markdown.

use std::fmt::Write;

use crate::operator::{FrameRule, Kind, Policy, Registry, Role, Stage, Timer};
use crate::params::{Names, ParamField, ParamType, Presence};

/// The page of all kinds.
pub fn reference(registry: &Registry) -> String {
    let mut page = String::from("# Operators\n");
    for stage in registry.iter() {
        page.push('\n');
        page.push_str(&reference_of(stage));
    }
    page
}

/// The section of one kind.
pub fn reference_of(stage: &Stage) -> String {
    let Kind { name, about, role, inputs, outputs, timer } = stage.kind;
    let mut page = format!("## {name}\n\n{about}\n");
    let role = match role {
        Role::Operator => "An operator",
        Role::Source => "A source",
    };
    let timer = match timer {
        Timer::No => "it has no timer",
        Timer::Optional => "`every` is optional and gives it a timer",
        Timer::Required => "`every` is required and gives the period of its timer",
    };
    let _ = writeln!(page, "\n{role}; {timer}.");
    if !inputs.is_empty() {
        page.push_str(
            "\n| input | takes | consumed | required | purpose |\n| --- | --- | --- | --- | --- |\n",
        );
        for i in inputs {
            let policy = policy_of(i.policy);
            let required = if i.required { "yes" } else { "no" };
            let _ = writeln!(
                page,
                "| `{}` | {} | {policy} | {required} | {} |",
                i.name,
                i.sample.name,
                cell(i.about)
            );
        }
    }
    if !outputs.is_empty() {
        page.push_str("\n| output | sends | frame | content |\n| --- | --- | --- | --- |\n");
        for o in outputs {
            let frame = frame_of(o.frame);
            let _ = writeln!(page, "| `{}` | {} | {frame} | {} |", o.name, o.sample.name, cell(o.about));
        }
    }
    if !stage.laps.is_empty() {
        let laps: Vec<String> = stage.laps.iter().map(|lap| format!("`{lap}_s`")).collect();
        let _ = writeln!(
            page,
            "\nA live run measures its laps and sends them on the topic `timing`: {}.",
            laps.join(", ")
        );
    }
    if !stage.fields.is_empty() {
        page.push_str(
            "\n| parameter | type | default | range | purpose |\n| --- | --- | --- | --- | --- |\n",
        );
        rows(&mut page, stage.fields, "");
    }
    page
}

/// How an input is consumed, as text.
pub fn policy_of(policy: Policy) -> String {
    match policy {
        Policy::Queue(n) => format!("`queue: {n}`"),
        Policy::Latest => "`latest: true`".into(),
        Policy::Sync { within } => format!("`sync` within {}", time(within)),
    }
}

/// The frame of an output, as text.
pub fn frame_of(rule: FrameRule) -> String {
    match rule {
        FrameRule::None => "none".into(),
        FrameRule::Key => "`frame`".into(),
        FrameRule::KeyOr(input) => format!("`frame`, else that of `{input}`"),
        FrameRule::SameAs(input) => format!("that of `{input}`"),
        FrameRule::Named(name) => format!("`{name}`"),
    }
}

fn rows(page: &mut String, fields: &[ParamField], prefix: &str) {
    for field in fields {
        let name = format!("{prefix}{}", field.name);
        let default = match (field.default, field.presence) {
            (Some(default), _) => format!("`{default}`"),
            (None, Presence::Optional) => "none".into(),
            (None, _) if field.is_required() => "required".into(),
            (None, _) => "see its parts".into(),
        };
        let range = match field.choices() {
            [] => field.range().unwrap_or_default(),
            choices => choices.iter().map(|c| format!("`{c}`")).collect::<Vec<_>>().join(", "),
        };
        let ty = match field.is_live {
            true => format!("{}, live", type_of(field)),
            false => type_of(field),
        };
        let _ = writeln!(page, "| `{name}` | {ty} | {default} | {range} | {} |", cell(field.about));
        if let ParamType::Group(nested) = field.ty {
            rows(page, nested, &format!("{name}."));
        }
    }
}

/// What a parameter may be, in words.
pub fn type_of(field: &ParamField) -> String {
    ty(field, field.ty)
}

fn ty(field: &ParamField, ty_of: ParamType) -> String {
    match ty_of {
        ParamType::Number | ParamType::Integer { .. } if !field.unit.is_empty() => {
            crate::config::units::find(field.unit)
                .map_or_else(String::new, |(d, _)| format!("{} ({})", d.name, field.unit))
        }
        ParamType::Number => "a number".into(),
        ParamType::Integer { .. } => "a whole number".into(),
        ParamType::Switch => "`true` or `false`".into(),
        ParamType::Text | ParamType::Choice(_) => match field.names {
            Names::Nothing if !field.choices().is_empty() => "a word".into(),
            Names::Nothing => "a text".into(),
            Names::File => "a file".into(),
            Names::Files(_) => "files".into(),
        },
        ParamType::List { of, len: Some(len) } => format!("{len} times {}", ty(field, *of)),
        ParamType::List { of, len: None } => format!("a list of {}", ty(field, *of)),
        ParamType::Group(_) => "a mapping".into(),
    }
}

/// A time in the largest unit that keeps it whole.
fn time(ns: u64) -> String {
    for (unit, size) in [("s", 1_000_000_000), ("ms", 1_000_000), ("us", 1_000)] {
        if ns > 0 && ns.is_multiple_of(size) {
            return format!("{} {unit}", ns / size);
        }
    }
    format!("{ns} ns")
}

/// A text that does not end its cell.
fn cell(text: &str) -> String {
    text.replace('|', "\\|")
}
