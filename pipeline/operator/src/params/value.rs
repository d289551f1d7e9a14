//! The types that a parameter can have.

use serde_json::{Value as Json, json};

use super::{Names, ParamField, ParamReader};
use crate::config::faults::{Code, Complaint};
use crate::config::near::{listed, shown};
use crate::config::quantity;
use crate::config::tree::{Node, TEXT, Value};

/// Type of a parameter, for schema and reference.
#[derive(Clone, Copy, Debug)]
pub enum ParamType {
    /// A number; a quantity where the field has a unit.
    Number,
    /// A whole number within the limits of its machine type.
    Integer {
        /// Least value.
        least: i128,
        /// Greatest value.
        greatest: i128,
    },
    /// `true` or `false`.
    Switch,
    /// A text.
    Text,
    /// One of these texts.
    Choice(&'static [&'static str]),
    /// A list.
    List {
        /// Type of its items.
        of: &'static ParamType,
        /// Number of its items, where it is fixed.
        len: Option<usize>,
    },
    /// A mapping with these fields.
    Group(&'static [ParamField]),
}

/// What follows if a config does not give a parameter without a default.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Presence {
    /// A fault.
    Required,
    /// There is none.
    Optional,
    /// Its fields have their defaults.
    Group,
}

/// A type that a parameter can have. `#[derive(Params)]` and `#[derive(Choice)]` make it of structs and enums.
pub trait ParamValue: Sized {
    /// The type, for schema and reference.
    const TYPE: ParamType;
    /// What follows if the config does not give it.
    const PRESENCE: Presence = Presence::Required;
    /// Reads it; faults go into the reader.
    fn read(node: &Node, field: &ParamField, reader: &ParamReader<'_>) -> Option<Self>;
    /// The value where the config gives none and there is no default; a fault where there must be one.
    fn absent(field: &ParamField, reader: &ParamReader<'_>) -> Option<Self> {
        reader.missing(field);
        None
    }
    /// The value in SI units.
    fn resolved(&self) -> Json;
}

/// Reads a scalar; `read` says what is wrong with it.
fn scalar<T>(
    node: &Node,
    field: &ParamField,
    reader: &ParamReader<'_>,
    expected: &str,
    read: impl FnOnce(&str) -> Result<T, Complaint>,
) -> Option<T> {
    let text = node.scalar(&shown(field.name), expected, reader.findings())?;
    read(text).map_err(|c| reader.complain(node, field, c)).ok()
}

fn expected(field: &ParamField, plain: &'static str) -> String {
    match crate::config::units::find(field.unit) {
        Some((dimension, _)) => dimension.name.to_owned(),
        None => plain.to_owned(),
    }
}

fn outside(text: &str, field: &ParamField, bound: &str) -> Complaint {
    let help = match field.above == Some(bound) {
        true => "write a greater value".to_owned(),
        false => format!("the nearest allowed value is `{bound}`"),
    };
    let range = field.range().unwrap_or_default();
    Complaint::new(Code::OutOfRange, format!("{} is out of range: it must be {range}", shown(text)), help)
}

fn number(text: &str, field: &ParamField) -> Result<f64, Complaint> {
    let read = |t: &str| if field.unit.is_empty() { quantity::plain(t) } else { quantity::si(t, field.unit) };
    let value = read(text)?;
    for (bound, is_outside) in [
        (field.min, (|v, b| v < b) as fn(f64, f64) -> bool),
        (field.above, |v, b| v <= b),
        (field.max, |v, b| v > b),
    ] {
        if let Some(bound) = bound
            && is_outside(value, read(bound)?)
        {
            return Err(outside(text, field, bound));
        }
    }
    Ok(value)
}

fn integer(text: &str, field: &ParamField, least: i128, greatest: i128) -> Result<i128, Complaint> {
    let read = |t: &str| {
        if field.unit.is_empty() { quantity::whole(t) } else { quantity::whole_in(t, field.unit) }
    };
    let value = read(text)?;
    for (bound, is_outside) in [
        (field.min, (|v, b| v < b) as fn(i128, i128) -> bool),
        (field.above, |v, b| v <= b),
        (field.max, |v, b| v > b),
    ] {
        if let Some(bound) = bound
            && is_outside(value, read(bound)?)
        {
            return Err(outside(text, field, bound));
        }
    }
    if value < least || value > greatest {
        let nearest = if value < least { least } else { greatest };
        return Err(Complaint::new(
            Code::OutOfRange,
            format!("{} is out of range: it must be from {least} to {greatest}", shown(text)),
            format!("the nearest allowed value is `{nearest}`"),
        ));
    }
    Ok(value)
}

impl ParamValue for f64 {
    const TYPE: ParamType = ParamType::Number;
    fn read(node: &Node, field: &ParamField, reader: &ParamReader<'_>) -> Option<Self> {
        scalar(node, field, reader, &expected(field, "a number"), |text| number(text, field))
    }
    fn resolved(&self) -> Json {
        json!(self)
    }
}

impl ParamValue for f32 {
    const TYPE: ParamType = ParamType::Number;
    fn read(node: &Node, field: &ParamField, reader: &ParamReader<'_>) -> Option<Self> {
        scalar(node, field, reader, &expected(field, "a number"), |text| {
            let value = number(text, field)? as f32;
            value.is_finite().then_some(value).ok_or_else(|| {
                Complaint::new(
                    Code::OutOfRange,
                    format!("{} is too large", shown(text)),
                    "write a smaller number",
                )
            })
        })
    }
    fn resolved(&self) -> Json {
        json!(f64::from(*self))
    }
}

macro_rules! integers {
    ($($int:ty),*) => {$(
        impl ParamValue for $int {
            const TYPE: ParamType =
                ParamType::Integer { least: <$int>::MIN as i128, greatest: <$int>::MAX as i128 };
            fn read(node: &Node, field: &ParamField, reader: &ParamReader<'_>) -> Option<Self> {
                let value = scalar(node, field, reader, &expected(field, "a whole number"), |text| {
                    integer(text, field, <$int>::MIN as i128, <$int>::MAX as i128)
                })?;
                Self::try_from(value).ok()
            }
            fn resolved(&self) -> Json {
                json!(self)
            }
        }
    )*};
}
integers!(u8, u16, u32, u64, usize, i32, i64);

impl ParamValue for bool {
    const TYPE: ParamType = ParamType::Switch;
    fn read(node: &Node, field: &ParamField, reader: &ParamReader<'_>) -> Option<Self> {
        if let Value::Switch(on) = node.value {
            return Some(on);
        }
        scalar(node, field, reader, "`true` or `false`", |text| match text {
            "true" => Ok(true),
            "false" => Ok(false),
            other => {
                let help = match other.to_ascii_lowercase().as_str() {
                    "yes" | "on" | "y" | "1" | "true" => "write `true`",
                    "no" | "off" | "n" | "0" | "false" => "write `false`",
                    _ => "write `true` or `false`",
                };
                let message = format!("{} is neither `true` nor `false`", shown(other));
                Err(Complaint::new(Code::UnknownChoice, message, help))
            }
        })
    }
    fn resolved(&self) -> Json {
        json!(self)
    }
}

impl ParamValue for String {
    const TYPE: ParamType = ParamType::Text;
    fn read(node: &Node, field: &ParamField, reader: &ParamReader<'_>) -> Option<Self> {
        let text = if field.choices.is_empty() {
            node.scalar(&shown(field.name), TEXT, reader.findings())?
        } else {
            reader.choice(node, field, field.choices)?
        };
        match field.names {
            Names::Nothing => Some(text.to_owned()),
            _ => reader.file(node, field, text),
        }
    }
    fn resolved(&self) -> Json {
        json!(self)
    }
}

impl<T: ParamValue, const N: usize> ParamValue for [T; N] {
    const TYPE: ParamType = ParamType::List { of: &T::TYPE, len: Some(N) };
    fn read(node: &Node, field: &ParamField, reader: &ParamReader<'_>) -> Option<Self> {
        let expected = format!("a list of {N}");
        let items = node.list(&shown(field.name), &expected, reader.findings())?;
        if items.len() != N {
            reader.findings().say(
                node.span,
                Code::WrongShape,
                format!("`{}` has {} items, but must have {N}", field.name, items.len()),
                format!("write {expected}"),
            );
        }
        let read: Vec<Option<T>> = items.iter().map(|item| T::read(item, field, reader)).collect();
        read.into_iter().collect::<Option<Vec<T>>>()?.try_into().ok()
    }
    fn resolved(&self) -> Json {
        self.iter().map(ParamValue::resolved).collect()
    }
}

impl<T: ParamValue> ParamValue for Vec<T> {
    const TYPE: ParamType = ParamType::List { of: &T::TYPE, len: None };
    fn read(node: &Node, field: &ParamField, reader: &ParamReader<'_>) -> Option<Self> {
        let items = node.list(&shown(field.name), "a list", reader.findings())?;
        let read: Vec<Option<T>> = items.iter().map(|item| T::read(item, field, reader)).collect();
        read.into_iter().collect()
    }
    fn resolved(&self) -> Json {
        self.iter().map(ParamValue::resolved).collect()
    }
}

impl<T: ParamValue> ParamValue for Option<T> {
    const TYPE: ParamType = T::TYPE;
    const PRESENCE: Presence = Presence::Optional;
    fn read(node: &Node, field: &ParamField, reader: &ParamReader<'_>) -> Option<Self> {
        match node.value {
            Value::Nothing => Some(None),
            _ => T::read(node, field, reader).map(Some),
        }
    }
    fn absent(_: &ParamField, _: &ParamReader<'_>) -> Option<Self> {
        Some(None)
    }
    fn resolved(&self) -> Json {
        self.as_ref().map_or(Json::Null, ParamValue::resolved)
    }
}

/// What a parameter may be, in a help line.
pub(super) fn choices_help(names: &'static [&'static str]) -> String {
    listed(names.iter().copied(), "it may be")
}
