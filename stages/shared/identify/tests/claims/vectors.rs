//! `d_pem` of SCIENCE D4, and the reference fit of a recorded sequence.

use nalgebra::DVector;
use serde_json::Value;
use stillpoint_identify::{Companion, Record, arx, fit};
use stillpoint_testing::reference;

const VECTORS: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../tests/vectors/d_pem.json"));

fn case(id: &str) -> Value {
    let vectors: Value = serde_json::from_str(VECTORS).unwrap();
    vectors["cases"].as_array().unwrap().iter().find(|c| c["id"] == id).unwrap().clone()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap_or_else(|| v[0].as_f64().unwrap())).collect()
}

fn close(case: &Value, found: f64, expected: f64) -> bool {
    let (rel, abs) = (case["tol"]["rel"].as_f64().unwrap(), case["tol"]["abs"].as_f64().unwrap());
    (found - expected).abs() <= abs + rel * expected.abs()
}

#[test]
fn predictor_follows_the_vectors() {
    let case = case("predictor");
    let input = &case["in"];
    let model = Companion {
        last: DVector::from_vec(numbers(&input["A"][1])),
        input: DVector::from_vec(numbers(&input["B"])),
        gain: DVector::from_vec(numbers(&input["K"])),
        start: DVector::from_vec(numbers(&input["x0"])),
    };
    let (u, y) = (numbers(&input["u"]), numbers(&input["y"]));
    let prediction = model.predict(&u, &y);
    for ((e, y), expected) in prediction.errors.iter().zip(&y).zip(numbers(&case["out"]["y_hat"])) {
        assert!(close(&case, y - e, expected), "{} is not {expected}", y - e);
    }
    assert!(close(&case, prediction.loss, case["out"]["V_N"].as_f64().unwrap()));
}

#[test]
fn arx_start_follows_the_vectors() {
    let case = case("arx");
    let (a, b) = arx(&numbers(&case["in"]["u"]), &numbers(&case["in"]["y"]), 2).unwrap();
    for (found, expected) in a.iter().chain(&b).zip(numbers(&case["out"]["theta_a1_a2_b1_b2"])) {
        assert!(close(&case, *found, expected), "{found} is not {expected}");
    }
}

#[test]
fn reference_sequence_is_fitted_as_well_as_by_the_reference() {
    let Some(root) = reference::folder("perception/control") else { return };
    let reference: Value =
        serde_json::from_slice(&std::fs::read(root.join("kalman_pem_reference.json")).unwrap()).unwrap();
    let pem = &reference["runs"][0]["pem"];
    let text = std::fs::read_to_string(root.join("pem_io_1.csv")).unwrap();
    let rows: Vec<[f64; 2]> = text
        .lines()
        .skip(1)
        .map(|line| line.split_once(',').map(|(u, y)| [u.parse().unwrap(), y.parse().unwrap()]).unwrap())
        .collect();
    let (u, y): (Vec<f64>, Vec<f64>) = rows.iter().map(|[u, y]| (*u, *y)).unzip();
    let found = fit(&Record { input: &u, output: &y }, 2).unwrap();
    eprintln!("{found:#?}");
    // The start is fitted too, so the loss may only be less.
    let loss = pem["loss_at_estimate"].as_f64().unwrap();
    assert!(found.loss <= loss * (1.0 + 1e-6) && found.loss > 0.99 * loss, "{} {loss}", found.loss);
    let poles = pem["poles"].as_array().unwrap();
    for (pole, expected) in found.poles.iter().zip(poles) {
        let expected = numbers(expected);
        for (part, expected) in [(pole.re, expected[0]), (pole.im, expected[1])] {
            assert!((part.value - expected).abs() < 0.2 * part.sd, "{part:?} is not {expected}");
        }
    }
    let gain = pem["dc_gain"].as_f64().unwrap();
    assert!(
        (found.dc_gain.unwrap().value - gain).abs() < 0.2 * found.dc_gain.unwrap().sd,
        "{:?} {gain}",
        found.dc_gain
    );
    let sd = pem["innovation_sd"].as_f64().unwrap();
    assert!((found.noise_variance.sqrt() / sd - 1.0).abs() < 0.01);
    assert!(found.residuals.iter().all(|t| t.passes()), "{:?}", found.residuals);
}
