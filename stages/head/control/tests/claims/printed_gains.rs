//! The gains that the dissertation prints for its linear-quadratic law (4.15), with its identified model (4.11) and its
//! weights (4.14): an example of a law that does nothing.

use nalgebra::{DMatrix, dmatrix};
use stillpoint_control::riccati::{Regulator, dlqr, spectral_radius};

/// (4.11).
fn plant() -> (DMatrix<f64>, DMatrix<f64>) {
    (dmatrix![0.0, 1.0; -0.9883, 1.988], dmatrix![-3.03e-7; -4.254e-7])
}

fn gain(a: &DMatrix<f64>, b: &DMatrix<f64>, effort: f64) -> DMatrix<f64> {
    let q = dmatrix![1.0566, 0.0; 0.0, 1.0566];
    dlqr(&Regulator { a, b, q: &q, r: &dmatrix![effort], n: None }).unwrap().k
}

/// The slowest of the poles, as a settling time in samples.
fn settling(a: &DMatrix<f64>) -> f64 {
    -4.0 / spectral_radius(a).ln()
}

#[test]
fn the_printed_weights_leave_the_plant_as_it_is() {
    let (a, b) = plant();
    let k = gain(&a, &b, 0.058006);
    assert!((k[0] - 0.64623).abs() < 1e-5 && (k[1] + 0.65425).abs() < 1e-5, "{k}");
    // In 4/|ln| samples, 680 of them, both settle alike: at 30 Hz 22.7 s, the 24 s that are reported.
    let (open, closed) = (settling(&a), settling(&(&a - &b * &k)));
    assert!((open / closed - 1.0).abs() < 1e-5, "{open} {closed}");
    assert!((open / 30.0 - 22.7).abs() < 0.1, "{}", open / 30.0);
}

#[test]
fn an_effort_as_small_as_the_inputs_effect_makes_the_law_act() {
    let (a, b) = plant();
    let k = gain(&a, &b, 1e-12);
    assert!(settling(&(&a - &b * k)) < settling(&a) / 5.0);
}

#[test]
fn the_printed_observer_runs_away_and_the_corrected_one_follows() {
    // (4.16) has the sign of K wrong: A + K C.
    let ((a, _), c, k) = (plant(), dmatrix![1.0, 0.0], dmatrix![0.9253; 0.9604]);
    assert!((spectral_radius(&(&a + &k * &c)) - 1.961).abs() < 1e-3);
    assert!((spectral_radius(&(&a - &k * &c)) - 0.9474).abs() < 1e-3);
}
