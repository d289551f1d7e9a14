//! Whether parameters are declared rightly: for a test over the kinds of a family.

use std::cell::RefCell;

use super::{ParamField, ParamReader, ParamType};
use crate::config::faults::{Code, Findings};
use crate::config::source::Span;
use crate::config::{quantity, units};
use crate::files::Files;
use crate::stage::Stage;

/// Whether descriptions, units, defaults and ranges of a kind's parameters can be read and agree with each other.
pub fn verify(stage: &Stage) -> Result<(), String> {
    let name = stage.kind.name;
    verify_fields(stage.fields).map_err(|reason| format!("{name}: {reason}"))?;
    let (findings, named) = (Findings::default(), RefCell::new(Vec::new()));
    (stage.read)(&mut ParamReader::new(&[], name, Span::default(), &findings, &Everything, &named));
    let faults = findings.into_faults(Default::default());
    match faults.list().iter().find(|f| f.code != Code::MissingParam) {
        Some(fault) => Err(format!("{name}: {}", fault.message)),
        None => Ok(()),
    }
}

/// Files of any name, so that only the declaration counts.
pub(super) struct Everything;

impl Files for Everything {
    fn read(&self, _: &str) -> Result<Vec<u8>, String> {
        Ok(Vec::new())
    }

    fn list(&self, name: &str) -> Result<Vec<String>, String> {
        Ok(vec![name.to_owned()])
    }
}

fn verify_fields(fields: &'static [ParamField]) -> Result<(), String> {
    for field in fields {
        let innermost = innermost(field.ty);
        if let ParamType::Group(nested) = innermost {
            verify_fields(nested)?;
        }
        if field.about.is_empty() {
            return Err(format!("`{}` has no description", field.name));
        }
        let bounds = [field.min, field.above, field.max].into_iter().flatten();
        let mut texts: Vec<&str> = bounds.collect();
        if !matches!(field.ty, ParamType::List { .. }) {
            texts.extend(field.default);
        }
        let known = units::find(field.unit);
        if !field.unit.is_empty() && known.is_none() {
            return Err(format!("`{}` has the unknown unit {}", field.name, field.unit));
        }
        for text in texts {
            let read = match innermost {
                ParamType::Number if field.unit.is_empty() => quantity::plain(text).map(|_| ()),
                ParamType::Number => {
                    let si = known.map(|(d, _)| d.si());
                    if si != Some(field.unit) {
                        return Err(format!("`{}` must be in SI: {}", field.name, si.unwrap_or_default()));
                    }
                    quantity::si(text, field.unit).map(|_| ())
                }
                ParamType::Integer { .. } if field.unit.is_empty() => quantity::whole(text).map(|_| ()),
                ParamType::Integer { .. } => quantity::whole_in(text, field.unit).map(|_| ()),
                ParamType::Text | ParamType::Choice(_)
                    if !field.choices().is_empty() && !field.choices().contains(&text) =>
                {
                    return Err(format!("`{}`: {text} is not a choice", field.name));
                }
                _ => Ok(()),
            };
            read.map_err(|c| format!("`{}`: {}", field.name, c.message))?;
        }
    }
    Ok(())
}

fn innermost(ty: ParamType) -> ParamType {
    match ty {
        ParamType::List { of, .. } => innermost(*of),
        other => other,
    }
}
