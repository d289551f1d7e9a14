//! Whether parameters are declared rightly: for a test over the kinds of a family.

use std::cell::RefCell;

use super::{ParamField, ParamReader, ParamType};
use crate::config::faults::{Code, Findings};
use crate::config::source::Span;
use crate::config::{quantity, units};
use crate::files::{Files, FilesError};
use crate::stage::Stage;

/// Why a kind's parameters are not declared rightly.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{kind}: {fault}")]
pub struct VerifyError {
    kind: &'static str,
    fault: DeclarationFault,
}

#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
enum DeclarationFault {
    #[error("`{0}` has no description")]
    Undescribed(&'static str),
    #[error("`{0}` has the unknown unit {1}")]
    Unit(&'static str, &'static str),
    #[error("`{0}` must be in SI: {1}")]
    NotSi(&'static str, &'static str),
    #[error("`{0}`: {1} is not a choice")]
    Choice(&'static str, &'static str),
    #[error("`{0}`: {1}")]
    Value(&'static str, String),
    #[error("{0}")]
    Read(String),
}

/// Whether descriptions, units, defaults and ranges of a kind's parameters can be read and agree with each other.
pub fn verify(stage: &Stage) -> Result<(), VerifyError> {
    let kind = stage.kind.name;
    verify_fields(stage.fields).map_err(|fault| VerifyError { kind, fault })?;
    let (findings, named) = (Findings::default(), RefCell::new(Vec::new()));
    (stage.read)(stage, &mut ParamReader::new(&[], kind, Span::default(), &findings, &Everything, &named));
    let faults = findings.into_faults(Default::default());
    match faults.list().iter().find(|f| f.code != Code::MissingParam) {
        Some(fault) => Err(VerifyError { kind, fault: DeclarationFault::Read(fault.message.clone()) }),
        None => Ok(()),
    }
}

/// Files of any name, so that only the declaration counts.
pub(super) struct Everything;

impl Files for Everything {
    fn read(&self, _: &str) -> Result<Vec<u8>, FilesError> {
        Ok(Vec::new())
    }

    fn list(&self, name: &str) -> Result<Vec<String>, FilesError> {
        Ok(vec![name.to_owned()])
    }
}

fn verify_fields(fields: &'static [ParamField]) -> Result<(), DeclarationFault> {
    for field in fields {
        let innermost = innermost(field.ty);
        if let ParamType::Group(nested) = innermost {
            verify_fields(nested)?;
        }
        if field.about.is_empty() {
            return Err(DeclarationFault::Undescribed(field.name));
        }
        let bounds = [field.min, field.above, field.max].into_iter().flatten();
        let mut texts: Vec<&str> = bounds.collect();
        if !matches!(field.ty, ParamType::List { .. }) {
            texts.extend(field.default);
        }
        let known = units::find(field.unit);
        if !field.unit.is_empty() && known.is_none() {
            return Err(DeclarationFault::Unit(field.name, field.unit));
        }
        for text in texts {
            let read = match innermost {
                ParamType::Number if field.unit.is_empty() => quantity::plain(text).map(|_| ()),
                ParamType::Number => {
                    let si = known.map(|(d, _)| d.si());
                    if si != Some(field.unit) {
                        return Err(DeclarationFault::NotSi(field.name, si.unwrap_or_default()));
                    }
                    quantity::si(text, field.unit).map(|_| ())
                }
                ParamType::Integer { .. } if field.unit.is_empty() => quantity::whole(text).map(|_| ()),
                ParamType::Integer { .. } => quantity::whole_in(text, field.unit).map(|_| ()),
                ParamType::Text | ParamType::Choice(_)
                    if !field.choices().is_empty() && !field.choices().contains(&text) =>
                {
                    return Err(DeclarationFault::Choice(field.name, text));
                }
                _ => Ok(()),
            };
            read.map_err(|c| DeclarationFault::Value(field.name, c.message))?;
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
