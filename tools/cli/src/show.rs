//! A sample as text or JSON, by the field table of its kind.

use serde_json::{Map, Value, json};
use stillpoint_samples::{
    Diagnostics, Field, HEADER_FIELDS, HEADER_SIZE, Pieces, Primitive, Sample, SampleKind,
};

/// Elements that are shown; more are counted.
const SHOWN: usize = 8;
/// Named numbers that are shown.
const NAMED_SHOWN: usize = 64;

/// A sample as JSON: head, body, and the first elements.
pub fn to_json(kind: &SampleKind, sample: Pieces<'_>) -> Value {
    let cut = sample.check(kind).unwrap_or(sample);
    let mut value = fields(HEADER_FIELDS, &cut.meta[..HEADER_SIZE.min(cut.meta.len())]);
    if !kind.body.is_empty() {
        value.extend(fields(kind.body, cut.meta.get(HEADER_SIZE..).unwrap_or(&[])));
    }
    let elements: Vec<Value> = cut
        .payload
        .chunks_exact(kind.element_size.max(1))
        .take(if *kind == *Diagnostics::KIND { NAMED_SHOWN } else { SHOWN })
        .map(|bytes| match kind.bare {
            Some(primitive) => number(primitive, bytes),
            None => Value::Object(fields(kind.element, bytes)),
        })
        .collect();
    value.insert("elements".to_string(), Value::Array(elements));
    Value::Object(value)
}

fn fields(fields: &[Field], bytes: &[u8]) -> Map<String, Value> {
    let mut map = Map::new();
    let mut at = 0;
    for field in fields {
        let Some(own) = bytes.get(at..at + field.size()) else { break };
        at += field.size();
        let size = field.primitive.size();
        let value = match (field.array, field.primitive) {
            (0, primitive) => number(primitive, own),
            (_, Primitive::U8) => text(own),
            (_, primitive) => Value::Array(own.chunks_exact(size).map(|b| number(primitive, b)).collect()),
        };
        map.insert(field.name.to_string(), value);
    }
    map
}

/// Bytes as text where they are text filled with zeros, else as numbers.
fn text(bytes: &[u8]) -> Value {
    let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
    match std::str::from_utf8(&bytes[..end]) {
        Ok(text) if bytes[end..].iter().all(|b| *b == 0) => json!(text),
        _ => json!(bytes),
    }
}

fn number(primitive: Primitive, bytes: &[u8]) -> Value {
    let mut wide = [0u8; 8];
    let n = bytes.len().min(8);
    wide[..n].copy_from_slice(&bytes[..n]);
    let bits = u64::from_le_bytes(wide);
    // JSON has no NaN and no infinity: they stand as text.
    let float = |x: f64| if x.is_finite() { json!(x) } else { json!(x.to_string()) };
    match primitive {
        Primitive::F64 => float(f64::from_bits(bits)),
        Primitive::F32 => float(f64::from(f32::from_bits(bits as u32))),
        Primitive::I8 => json!(bits as u8 as i8),
        Primitive::I16 => json!(bits as u16 as i16),
        Primitive::I32 => json!(bits as u32 as i32),
        Primitive::I64 => json!(bits as i64),
        _ => json!(bits),
    }
}
