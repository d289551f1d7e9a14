//! Vector files: named cases with inputs, outputs and tolerances.

use nalgebra::{DMatrix, SVector};
use serde_json::Value;

/// The cases of a file of `tests/vectors`.
pub fn cases(text: &str) -> Vec<Value> {
    let file: Value = serde_json::from_str(text).unwrap();
    let cases = file["cases"].as_array().unwrap().clone();
    assert!(!cases.is_empty());
    cases
}

pub fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("no number: {value}"))
}

pub fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(number).collect()
}

pub fn matrix(value: &Value) -> DMatrix<f64> {
    let rows: Vec<Vec<f64>> = value.as_array().unwrap().iter().map(numbers).collect();
    DMatrix::from_fn(rows.len(), rows[0].len(), |i, j| rows[i][j])
}

pub fn vector<const N: usize>(value: &Value) -> SVector<f64, N> {
    let numbers = numbers(value);
    assert_eq!(numbers.len(), N);
    SVector::from_column_slice(&numbers)
}

/// |a - b| <= abs + rel |b|, as the vectors say.
pub fn assert_close(case: &Value, what: &str, found: f64, expected: f64) {
    let (rel, abs) = (number(&case["tol"]["rel"]), number(&case["tol"]["abs"]));
    assert!(
        (found - expected).abs() <= abs + rel * expected.abs(),
        "{} {what}: {found} is not {expected}",
        case["id"]
    );
}

pub fn assert_all_close(case: &Value, what: &str, found: &[f64], expected: &Value) {
    let expected = numbers(expected);
    assert_eq!(found.len(), expected.len(), "{what}");
    for (i, (found, expected)) in found.iter().zip(&expected).enumerate() {
        assert_close(case, &format!("{what}[{i}]"), *found, *expected);
    }
}

pub fn assert_matrix_close(case: &Value, what: &str, found: &DMatrix<f64>, expected: &Value) {
    let expected = matrix(expected);
    assert_eq!(found.shape(), expected.shape(), "{what}");
    for (i, (found, expected)) in found.iter().zip(expected.iter()).enumerate() {
        assert_close(case, &format!("{what}[{i}]"), *found, *expected);
    }
}

macro_rules! vectors {
    ($name:literal) => {
        include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../tests/vectors/", $name, ".json"))
    };
}
pub(crate) use vectors;
