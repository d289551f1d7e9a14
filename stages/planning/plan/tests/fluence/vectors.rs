//! Fluence against the test vectors of SCIENCE F.

use serde_json::Value;
use stillpoint_plan::Csc;
use stillpoint_plan::fluence::admm::{self, Admm, prox};
use stillpoint_plan::fluence::{Csr, Options, Problem, Side, Term, solve};

fn cases(name: &str) -> Vec<Value> {
    let path = format!("{}/../../../tests/vectors/{name}.json", env!("CARGO_MANIFEST_DIR"));
    let vectors: Value = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    vectors["cases"].as_array().unwrap().clone()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

/// A dense matrix as it stands in the vectors; entries are rounded to `f32`.
fn matrix(value: &Value) -> Csr {
    let rows: Vec<Vec<f64>> = value.as_array().unwrap().iter().map(numbers).collect();
    let (mut starts, mut row, mut values) = (vec![0], Vec::new(), Vec::new());
    for j in 0..rows[0].len() {
        for (i, r) in rows.iter().enumerate().filter(|(_, r)| r[j] != 0.0) {
            row.push(i as u32);
            values.push(r[j] as f32);
        }
        starts.push(row.len() as u64);
    }
    Csr::from_columns(Csc::new(rows.len(), starts, row, values).unwrap().view())
}

/// |a - b| <= abs + rel |b|, as the vectors say.
fn assert_near(case: &Value, what: &str, found: &[f64], expected: &[f64]) {
    let [rel, abs] = ["rel", "abs"].map(|k| case["tol"][k].as_f64().unwrap());
    assert_eq!(found.len(), expected.len());
    for (a, b) in found.iter().zip(expected) {
        assert!((a - b).abs() <= abs + rel * b.abs(), "{} {what}: {a} is not {b}", case["id"]);
    }
}

/// The vectors have the factor 1/2 of (5.1); ours has none, so their weights are halved.
fn over_under(case: &Value) -> Problem {
    let input = &case["in"];
    let half = |key: &str| numbers(&input[key]).iter().map(|w| w / 2.0).collect::<Vec<_>>();
    let b = numbers(&input["b"]);
    Problem::from_bounds(matrix(&input["D"]), &b, &b, &half("w_over"), &half("w_under")).unwrap()
}

#[test]
fn prox_of_a_voxel_is_that_of_the_vectors() {
    for case in cases("f_prox") {
        let input = &case["in"];
        let number = |key: &str| input[key].as_f64().unwrap();
        let found: Vec<f64> = numbers(&input["v"])
            .iter()
            .zip(numbers(&input["b"]))
            .map(|(v, goal)| {
                let term = |side, weight: f64| Term { row: 0, side, goal, weight: weight / 2.0 };
                let terms = [term(Side::Over, number("w_over")), term(Side::Under, number("w_under"))];
                prox(&terms, number("rho"), *v)
            })
            .collect();
        assert_near(&case, "y", &found, &numbers(&case["out"]["y"]));
    }
}

#[test]
fn least_squares_by_admm_takes_the_iterations_of_the_vectors() {
    for case in cases("f_nnls_admm") {
        let (input, out) = (&case["in"], &case["out"]);
        let number = |key: &str| input[key].as_f64().unwrap();
        let parameters = Admm {
            rho: number("rho"),
            alpha: number("alpha"),
            eps_abs: number("eps_abs"),
            eps_rel: number("eps_rel"),
            max_iterations: 1000,
        };
        let matrix = matrix(&input["A"]);
        let b = numbers(&input["b"]);
        let found = admm::least_squares(&matrix, &b, &parameters).unwrap();
        let expected = out["admm_iterations_at_given_eps"].as_i64().unwrap();
        assert!(
            (found.history.len() as i64 - expected).abs() <= 1,
            "{}: {}",
            case["id"],
            found.history.len()
        );
        assert_near(&case, "z", &found.z, &numbers(&out["admm_z_at_stop"]));
        assert_near(&case, "lambda", &found.lambda, &numbers(&out["admm_lambda_at_stop"]));
        for (r, expected) in
            found.history.iter().zip(out["residuals_first3_r_s_epri_edual"].as_array().unwrap())
        {
            let r = [r.primal, r.dual, r.primal_tolerance, r.dual_tolerance];
            assert_near(&case, "residuals", &r, &numbers(expected));
        }
        let tight = Admm { eps_abs: 1e-11, eps_rel: 1e-11, max_iterations: 100_000, ..parameters };
        let found = admm::least_squares(&matrix, &b, &tight).unwrap();
        assert_near(&case, "x_opt", &found.z, &numbers(&out["x_opt"]));
    }
}

#[test]
fn over_and_under_dose_by_newton_is_the_optimum_of_the_vectors() {
    for case in cases("f_fmo_overunder") {
        let found = solve(&over_under(&case), None, Options { tolerance: 1e-12, ..Options::default() });
        assert!(found.certificate.kkt < 1e-12, "{}: {:?}", case["id"], found.certificate);
        assert_near(&case, "x_opt", &found.x, &numbers(&case["out"]["x_opt"]));
        let expected = case["out"]["objective"].as_f64().unwrap();
        assert!((found.certificate.objective / expected - 1.0).abs() < 1e-6);
    }
}

#[test]
fn over_and_under_dose_by_admm_is_the_optimum_of_the_vectors() {
    for case in cases("f_fmo_overunder") {
        let number = |key: &str| case["in"][key].as_f64().unwrap();
        let parameters = Admm {
            rho: number("rho"),
            alpha: number("alpha"),
            eps_abs: 1e-10,
            eps_rel: 1e-10,
            max_iterations: 2000,
        };
        let (found, certificate) = admm::solve(&over_under(&case), &parameters).unwrap();
        assert!(found.history.len() < 400, "{}: {} iterations", case["id"], found.history.len());
        assert!(certificate.kkt < 1e-8, "{}: {certificate:?}", case["id"]);
        assert_near(&case, "x_opt", &found.z, &numbers(&case["out"]["x_opt"]));
    }
}
