//! A sample as JSON, by the field table of its kind.

use serde_json::{Map, Value, json};
use stillpoint_samples::{
    Diagnostics, Field, HEADER_FIELDS, HEADER_SIZE, Pieces, Primitive, Sample, SampleKind,
};

use crate::number::Number;
use crate::path::ValuePath;

/// Elements that are shown; more are counted.
const SHOWN: usize = 8;
/// Named numbers that are shown.
pub const NAMED_SHOWN: usize = 64;
/// The key of the words of an object's codes and bits.
const WORDS: &str = "words";

/// Elements of a sample that are shown.
pub fn shown(kind: &SampleKind) -> usize {
    if *kind == *Diagnostics::KIND { NAMED_SHOWN } else { SHOWN }
}

/// A sample as JSON: head, body, and the first elements. `words` of an object has the words of its codes and bits.
pub fn to_json(kind: &SampleKind, sample: Pieces<'_>) -> Value {
    let cut = sample.check(kind).unwrap_or(sample);
    let mut value = fields(HEADER_FIELDS, &cut.meta[..HEADER_SIZE.min(cut.meta.len())]);
    if !kind.body.is_empty() {
        value.extend(fields(kind.body, cut.meta.get(HEADER_SIZE..).unwrap_or(&[])));
    }
    let elements: Vec<Value> = cut
        .payload
        .chunks_exact(kind.element_size.max(1))
        .take(shown(kind))
        .map(|bytes| match kind.bare {
            Some(primitive) => Number::of(primitive, bytes).json(),
            None => Value::Object(fields(kind.element, bytes)),
        })
        .collect();
    value.insert("elements".to_string(), Value::Array(elements));
    Value::Object(value)
}

/// The values behind paths as JSON, with sequence and stamp. A value that the sample does not have is null.
pub fn values_json(kind: &'static SampleKind, sample: Pieces<'_>, paths: &[ValuePath]) -> Value {
    let header = sample.header();
    let mut map = Map::new();
    map.insert("sequence".to_owned(), json!(header.sequence));
    map.insert("stamp".to_owned(), json!(header.stamp));
    let mut words = Map::new();
    for path in paths {
        let value = match path.find(kind, sample) {
            None => Value::Null,
            Some(found) if found.is_array => Value::Array(found.values.iter().map(|n| n.json()).collect()),
            Some(found) => {
                if let (Some(field), Number::Unsigned(number)) = (found.field, found.values[0])
                    && let Some(message) = field.names.words(number)
                {
                    words.insert(path.to_string(), json!(message));
                }
                found.values[0].json()
            }
        };
        map.insert(path.to_string(), value);
    }
    if !words.is_empty() {
        map.insert(WORDS.to_owned(), Value::Object(words));
    }
    Value::Object(map)
}

fn fields(fields: &[Field], bytes: &[u8]) -> Map<String, Value> {
    let (mut map, mut words) = (Map::new(), Map::new());
    let mut at = 0;
    for field in fields {
        let Some(own) = bytes.get(at..at + field.size()) else { break };
        at += field.size();
        let value = match (field.array, field.primitive) {
            (0, primitive) => {
                let number = Number::of(primitive, own);
                if let Number::Unsigned(code) = number
                    && let Some(message) = field.names.words(code)
                {
                    words.insert(field.name.to_owned(), json!(message));
                }
                number.json()
            }
            (_, Primitive::U8) => json_text(own),
            _ => Value::Array(Number::all(field, own).into_iter().map(Number::json).collect()),
        };
        map.insert(field.name.to_string(), value);
    }
    if !words.is_empty() {
        map.insert(WORDS.to_owned(), Value::Object(words));
    }
    map
}

fn json_text(bytes: &[u8]) -> Value {
    text(bytes).map_or_else(|| json!(bytes), |text| json!(text))
}

/// Bytes as text, where they are text filled with zeros.
pub fn text(bytes: &[u8]) -> Option<&str> {
    let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
    std::str::from_utf8(&bytes[..end]).ok().filter(|_| bytes[end..].iter().all(|b| *b == 0))
}
