//! A file of vectors, and the comparison that it asks for.

use serde_json::Value;

/// One case: inputs, expected outputs, tolerance.
pub struct Case {
    pub id: String,
    pub given: Value,
    pub expected: Value,
    relative: f64,
    absolute: f64,
}

/// The cases of `tests/vectors/<name>.json`; at least one.
pub fn cases(name: &str) -> Vec<Case> {
    let path = format!("{}/../../../tests/vectors/{name}.json", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{path}: {e}"));
    let file: Value = serde_json::from_str(&text).unwrap();
    let cases: Vec<Case> = file["cases"]
        .as_array()
        .unwrap()
        .iter()
        .map(|case| Case {
            id: case["id"].as_str().unwrap().to_string(),
            given: case["in"].clone(),
            expected: case["out"].clone(),
            relative: number(&case["tol"]["rel"]),
            absolute: number(&case["tol"]["abs"]),
        })
        .collect();
    assert!(!cases.is_empty(), "{path} has no cases");
    cases
}

pub fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is not a number"))
}

/// The numbers of an array.
pub fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap_or_else(|| panic!("{value} is not an array")).iter().map(number).collect()
}

/// The numbers of an array of known length.
pub fn array<const N: usize>(value: &Value) -> [f64; N] {
    numbers(value).try_into().unwrap_or_else(|_| panic!("{value} has not {N} numbers"))
}

impl Case {
    /// A number among the inputs.
    pub fn input(&self, name: &str) -> f64 {
        number(&self.given[name])
    }

    /// Holds one number to the file's tolerance.
    pub fn hold(&self, what: &str, found: f64, expected: f64) {
        let allowed = self.absolute + self.relative * expected.abs();
        assert!(
            (found - expected).abs() <= allowed,
            "{} {what}: found {found:e}, expected {expected:e}, allowed {allowed:e}",
            self.id
        );
    }

    /// Holds numbers to those of an array among the outputs.
    pub fn hold_all(&self, name: &str, found: &[f64]) {
        let expected = numbers(&self.expected[name]);
        assert_eq!(found.len(), expected.len(), "{} {name}: {found:?}", self.id);
        for (i, (f, e)) in found.iter().zip(expected).enumerate() {
            self.hold(&format!("{name}[{i}]"), *f, e);
        }
    }

    /// Holds a number to one among the outputs.
    pub fn hold_output(&self, name: &str, found: f64) {
        self.hold(name, found, number(&self.expected[name]));
    }
}
