//! Hashes of types: RIHS01, the SHA-256 of a description of the type and of all types that it refers to. Two programs that
//! have the same hash mean the same message.
//!
//! The description is made from the `ros2msg` text of a type, in which the types that it refers to follow behind lines
//! of `=`, as recordings hold it.

use std::collections::BTreeMap;
use std::fmt::Write;

use sha2::{Digest, Sha256};
use thiserror::Error;

/// Number of a field's type in a description: that of a type of its own, and those of numbers and texts.
const NESTED: u32 = 1;
const PRIMITIVES: [(&str, u32); 14] = [
    ("int8", 2),
    ("uint8", 3),
    ("int16", 4),
    ("uint16", 5),
    ("int32", 6),
    ("uint32", 7),
    ("int64", 8),
    ("uint64", 9),
    ("float32", 10),
    ("float64", 11),
    ("char", 13),
    ("bool", 15),
    ("byte", 16),
    ("string", 17),
];
/// What an array, a sequence of at most so many, and a sequence of any length add to the number of their element.
const ARRAY: u32 = 48;
const BOUNDED: u32 = 96;
const SEQUENCE: u32 = 144;

/// Why a text describes no type.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum DescriptionError {
    /// A line is no field.
    #[error("`{0}` is not a field")]
    Line(String),
    /// A type that a field has is not described.
    #[error("the type `{0}` is not described")]
    Unknown(String),
}

/// The hash of a type, `RIHS01_` with 64 hexadecimal digits. `text` is its `ros2msg` text.
///
/// # Errors
/// A line that is no field, or a type that the text does not describe.
pub fn rihs01(type_name: &str, text: &str) -> Result<String, DescriptionError> {
    let mut described: BTreeMap<String, Vec<Field>> = BTreeMap::new();
    let mut sections = text.split(SEPARATOR);
    described.insert(type_name.to_owned(), fields(sections.next().unwrap_or_default())?);
    for section in sections {
        let section = section.trim_start_matches('=').trim_start();
        let (first, rest) = section.split_once('\n').unwrap_or((section, ""));
        let name = first.strip_prefix("MSG: ").ok_or_else(|| DescriptionError::Line(first.to_owned()))?;
        described.insert(whole_name(name.trim()), fields(rest)?);
    }
    let mut needed = Vec::new();
    refer(type_name, &described, &mut needed)?;
    needed.sort();
    let own = description(type_name, &described);
    let others: Vec<String> = needed.iter().map(|name| description(name, &described)).collect();
    let whole =
        format!("{{\"type_description\": {own}, \"referenced_type_descriptions\": [{}]}}", others.join(", "));
    let mut hash = "RIHS01_".to_owned();
    for byte in Sha256::digest(whole) {
        // Writing to a text cannot fail.
        let _ = write!(hash, "{byte:02x}");
    }
    Ok(hash)
}

/// The beginning of a line between two types.
const SEPARATOR: &str = "\n====";

struct Field {
    name: String,
    id: u32,
    capacity: u32,
    nested: String,
}

/// The fields of a type, without constants.
fn fields(text: &str) -> Result<Vec<Field>, DescriptionError> {
    let mut fields = Vec::new();
    for line in text.lines() {
        let line = line.split('#').next().unwrap_or_default().trim();
        if line.is_empty() {
            continue;
        }
        let wrong = || DescriptionError::Line(line.to_owned());
        let (type_name, rest) = line.split_once(char::is_whitespace).ok_or_else(wrong)?;
        // A constant has a value; what follows the name of a field is its default.
        if rest.contains('=') {
            continue;
        }
        let name = rest.split_whitespace().next().ok_or_else(wrong)?;
        fields.push(field(name, type_name).ok_or_else(wrong)?);
    }
    Ok(fields)
}

fn field(name: &str, type_name: &str) -> Option<Field> {
    let (element, array) = match type_name.split_once('[') {
        Some((element, rest)) => (element, Some(rest.strip_suffix(']')?)),
        None => (type_name, None),
    };
    let (added, capacity) = match array {
        None => (0, 0),
        Some("") => (SEQUENCE, 0),
        Some(count) => match count.strip_prefix("<=") {
            Some(count) => (BOUNDED, count.parse().ok()?),
            None => (ARRAY, count.parse().ok()?),
        },
    };
    let primitive = PRIMITIVES.iter().find(|(name, _)| *name == element);
    let nested = if primitive.is_some() { String::new() } else { whole_name(element) };
    if primitive.is_none() && !element.contains('/') {
        return None;
    }
    let id = primitive.map_or(NESTED, |(_, id)| *id) + added;
    Some(Field { name: name.to_owned(), id, capacity, nested })
}

/// `package/msg/Name` of `package/Name`.
fn whole_name(name: &str) -> String {
    match name.split_once('/') {
        Some((package, rest)) if !rest.contains('/') => format!("{package}/msg/{rest}"),
        _ => name.to_owned(),
    }
}

/// Adds all types that a type refers to, itself left out.
fn refer(
    of: &str,
    described: &BTreeMap<String, Vec<Field>>,
    needed: &mut Vec<String>,
) -> Result<(), DescriptionError> {
    let fields = described.get(of).ok_or_else(|| DescriptionError::Unknown(of.to_owned()))?;
    for nested in fields.iter().map(|f| &f.nested).filter(|n| !n.is_empty()) {
        if !needed.contains(nested) {
            needed.push(nested.clone());
            refer(nested, described, needed)?;
        }
    }
    Ok(())
}

fn description(name: &str, described: &BTreeMap<String, Vec<Field>>) -> String {
    let fields = described.get(name).map(Vec::as_slice).unwrap_or_default();
    let field = |f: &Field| {
        format!(
            "{{\"name\": \"{}\", \"type\": {{\"type_id\": {}, \"capacity\": {}, \"string_capacity\": 0, \
             \"nested_type_name\": \"{}\"}}}}",
            f.name, f.id, f.capacity, f.nested
        )
    };
    let fields: Vec<String> = fields.iter().map(field).collect();
    format!("{{\"type_name\": \"{name}\", \"fields\": [{}]}}", fields.join(", "))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn comments_constants_and_names_of_the_text_change_nothing_and_types_do() {
        let text = "uint8 A=1\n# words\nint32 sec  # s\nuint32 nanosec\n";
        let time = rihs01("builtin_interfaces/msg/Time", text).unwrap();
        // As ROS 2 has it for this type in all distributions from Iron on.
        assert_eq!(time, "RIHS01_b106235e25a4c5ed35098aa0a61a3ee9c9b18d197f398b0e4206cea9acf9c197");
        assert_ne!(rihs01("builtin_interfaces/msg/Time", "int32 sec\nint32 nanosec\n").unwrap(), time);
    }

    #[test]
    fn a_text_without_a_type_is_refused() {
        let refused = |text: &str| rihs01("a/msg/A", text).unwrap_err();
        assert_eq!(refused("Header header\n"), DescriptionError::Line("Header header".to_owned()));
        assert_eq!(refused("b/B b\n"), DescriptionError::Unknown("b/msg/B".to_owned()));
        assert_eq!(refused("uint8[x] b\n"), DescriptionError::Line("uint8[x] b".to_owned()));
        assert_eq!(refused("uint8\n"), DescriptionError::Line("uint8".to_owned()));
    }
}
