//! The fields of sample types, as JSON for the Python sources.

use pyo3::prelude::*;
use serde_json::{Value, json};
use stillpoint_samples::{Code, Field, HEADER_FIELDS, Names, SampleKind, Shape};

/// Every sample type by name, as JSON: header, body and element with the fields of each, in the order of their bytes.
#[pyfunction]
pub fn sample_kinds() -> String {
    let kinds = stillpoint_samples::all();
    Value::Object(kinds.iter().map(|kind| (kind.name.to_owned(), described(kind))).collect()).to_string()
}

/// A sample type as JSON.
pub fn described(kind: &SampleKind) -> Value {
    let fields = |fields: &[Field]| fields.iter().map(field).collect::<Vec<_>>();
    json!({
        "name": kind.name, "type": kind.type_name(), "about": kind.about,
        "is_slice": kind.shape == Shape::Slice,
        "header": fields(HEADER_FIELDS), "body": fields(kind.body), "element": fields(kind.element),
        "number": kind.bare.map(|primitive| primitive.ros_name()),
        "meta_size": kind.meta_size(), "element_size": kind.element_size,
    })
}

fn field(field: &Field) -> Value {
    let codes = |codes: &[Code]| -> Vec<Value> {
        codes.iter().map(|c| json!({ "word": c.word, "value": c.value, "about": c.about })).collect()
    };
    let (names, list) = match field.names {
        Names::None => ("none", json!([])),
        Names::Codes(all) => ("codes", json!(codes(all))),
        Names::Bits(all) => ("bits", json!(codes(all))),
        Names::Each(part) => ("each", json!(part)),
        Names::Parts(all) => ("parts", json!(codes(all))),
        Names::Rows(rows, columns) => ("rows", json!([rows, columns])),
    };
    json!({
        "name": field.name, "type": field.primitive.ros_name(), "array": field.array, "unit": field.unit,
        "about": field.about, "names": names, "list": list,
    })
}
