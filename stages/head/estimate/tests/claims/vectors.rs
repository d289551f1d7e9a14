//! The filter against the test vectors of SCIENCE D and a recorded sequence.

use nalgebra::{Matrix1, Matrix2, Vector1};
use serde_json::Value;
use stillpoint_estimate::cross;
use stillpoint_estimate::fusion::{cross_covariance, fused, inverse_variance, joint};
use stillpoint_estimate::{Kalman, KalmanParams, Measurement, ProcessNoise, State};
use stillpoint_testing::reference;

const VECTORS: &str =
    include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../tests/vectors/d_kalman_fusion.json"));

fn cases(prefix: &str) -> Vec<Value> {
    let vectors: Value = serde_json::from_str(VECTORS).unwrap();
    let of_prefix = |c: &&Value| c["id"].as_str().unwrap().trim_end_matches(char::is_numeric) == prefix;
    let cases: Vec<_> = vectors["cases"].as_array().unwrap().iter().filter(of_prefix).cloned().collect();
    assert!(!cases.is_empty(), "no cases {prefix}");
    cases
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

/// |a - b| <= abs + rel |b|, as the vectors say.
fn assert_close(case: &Value, what: &str, found: f64, expected: f64) {
    let (rel, abs) = (number(&case["tol"]["rel"]), number(&case["tol"]["abs"]));
    assert!(
        (found - expected).abs() <= abs + rel * expected.abs(),
        "{} {what}: {found} is not {expected}",
        case["id"]
    );
}

fn params(acceleration_sd: f64) -> KalmanParams<1> {
    KalmanParams {
        process: ProcessNoise::per_step(acceleration_sd),
        open_sd: Vector1::new(1.0),
        initial_velocity_sd: Vector1::new(10.0),
        gate: f64::INFINITY,
        horizon: u64::MAX,
    }
}

fn measured(z: f64, r: f64) -> Measurement<1> {
    Measurement { position: Vector1::new(z), covariance: Matrix1::new(r) }
}

/// Runs one track of a case with its exact `dt`, missing samples as predictions.
fn track(input: &Value, z: &str, r: &str) -> Vec<State<1>> {
    let at = |m: &Value, i: usize, j: usize| Matrix1::new(number(&m[i][j]));
    let p0 = &input["P0"];
    let mut state = State {
        position: Vector1::new(number(&input["x0"][0])),
        velocity: Vector1::new(number(&input["x0"][1])),
        pp: at(p0, 0, 0),
        pv: at(p0, 0, 1),
        vv: at(p0, 1, 1),
    };
    let (dt, r) = (number(&input["dt"]), number(&input[r]));
    let process = ProcessNoise::per_step(number(&input["sigma_a"]));
    let mut states = Vec::new();
    for z in input[z].as_array().unwrap() {
        state = state.predicted(dt, &process);
        if let Some(z) = z.as_f64() {
            let z = measured(z, r);
            state = state.updated(&state.innovation(&z).unwrap(), &z);
        }
        states.push(state);
    }
    states
}

fn assert_covariance(case: &Value, what: &str, state: &State<1>, expected: &Value) {
    for (found, i, j) in [(state.pp, 0, 0), (state.pv, 0, 1), (state.vv, 1, 1)] {
        assert_close(case, &format!("{what}[{i}][{j}]"), found.x, number(&expected[i][j]));
    }
}

#[test]
fn tracks_follow_the_vectors_through_missing_samples() {
    for case in cases("kf") {
        let out = &case["out"];
        for (z, r, x) in [("z1", "r1", "x1"), ("z2", "r2", "x2")] {
            let states = track(&case["in"], z, r);
            let expected = out[x].as_array().unwrap();
            assert_eq!(states.len(), expected.len());
            for (k, (state, expected)) in states.iter().zip(expected).enumerate() {
                assert_close(&case, &format!("{x}[{k}] position"), state.position.x, number(&expected[0]));
                assert_close(&case, &format!("{x}[{k}] velocity"), state.velocity.x, number(&expected[1]));
            }
            match x {
                "x1" => {
                    for (k, (state, expected)) in states.iter().zip(out["P1"].as_array().unwrap()).enumerate()
                    {
                        assert_covariance(&case, &format!("P1 after step {k}"), state, expected);
                    }
                }
                _ => assert_covariance(&case, "P2_last", states.last().unwrap(), &out["P2_last"]),
            }
        }
    }
}

#[test]
fn covariance_settles_at_the_riccati_solution() {
    for case in cases("kf_ss") {
        let dt = number(&case["in"]["dt"]);
        let process = ProcessNoise::per_step(number(&case["in"]["sigma_a"]));
        let z = measured(0.0, number(&case["in"]["r"]));
        let mut posterior = State::at_rest(&z, &Vector1::new(1.0), &Vector1::new(10.0));
        let mut prior = posterior;
        for _ in 0..5000 {
            prior = posterior.predicted(dt, &process);
            posterior = prior.updated(&prior.innovation(&z).unwrap(), &z);
        }
        let gain = prior.innovation(&z).unwrap();
        let out = &case["out"];
        assert_close(&case, "position gain", gain.position_gain.x, number(&out["gain"][0][0]));
        assert_close(&case, "velocity gain", gain.velocity_gain.x, number(&out["gain"][1][0]));
        for (state, name) in [(prior, "P_prior"), (posterior, "P_post")] {
            assert_covariance(&case, name, &state, &out[name]);
        }
    }
}

#[test]
fn fused_tracks_follow_the_vectors_as_printed_and_with_cross_covariance() {
    for case in cases("kf") {
        let (input, out) = (&case["in"], &case["out"]);
        let dt = number(&input["dt"]);
        let process = ProcessNoise::<1>::per_step(number(&input["sigma_a"]));
        let (x1, x2) = (track(input, "z1", "r1"), track(input, "z2", "r2"));
        let mut p12 = Matrix2::zeros();
        let mut last = None;
        for (k, (a, b)) in x1.iter().zip(&x2).enumerate() {
            p12 = cross::predicted(&p12, dt, &process);
            for (side, z, r) in [(0, "z1", "r1"), (1, "z2", "r2")] {
                // The gain that the track had: K = P H^T / R after the update, none for a missing sample.
                let own = [a, b][side];
                let r = number(&input[r]);
                if input[z][k].is_number() {
                    let keep = cross::keep::<1, 2>(&[own.pp / r, own.pv / r]);
                    p12 = if side == 0 { keep * p12 } else { p12 * keep.transpose() };
                }
            }
            let (p1, p2) = (joint::<1, 2, _>(a), joint::<1, 2, _>(b));
            let printed = fused(a, b, &inverse_variance(&p1, &p2).unwrap());
            let best = fused(a, b, &cross_covariance(&p1, &p2, &p12).unwrap());
            for (state, name) in [(printed, "x_fused_ivw"), (best, "x_fused_cross")] {
                let expected = &out[name][k];
                assert_close(&case, &format!("{name}[{k}] position"), state.position.x, number(&expected[0]));
                assert_close(&case, &format!("{name}[{k}] velocity"), state.velocity.x, number(&expected[1]));
            }
            last = Some((printed, best));
        }
        let (printed, best) = last.unwrap();
        assert_covariance(&case, "P_fused_ivw_last", &printed, &out["P_fused_ivw_last"]);
        assert_covariance(&case, "P_fused_cross_last", &best, &out["P_fused_cross_last"]);
        for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            assert_close(&case, "P12_last", p12[(i, j)], number(&out["P12_last"][i][j]));
        }
    }
}

#[test]
fn stamped_filter_follows_the_recorded_sequence() {
    let Some(root) = reference::folder("perception/control") else { return };
    let reference: Value =
        serde_json::from_slice(&std::fs::read(root.join("kalman_pem_reference.json")).unwrap()).unwrap();
    let run = &reference["runs"][0]["kalman"];
    let rows: Vec<Vec<f64>> = std::fs::read_to_string(root.join("kalman_seq_1.csv"))
        .unwrap()
        .lines()
        .skip(1)
        .map(|line| line.split(',').map(|v| v.parse().unwrap()).collect())
        .collect();
    for (sensor, z, x, v, p) in [(0, 2, 4, 5, "final_P1"), (1, 3, 6, 7, "final_P2")] {
        let sd = number(&run["sigma_r"][sensor]);
        let mut filter = Kalman::<1>::new(params(number(&run["sigma_a"]))).unwrap();
        let mut worst = (0.0_f64, 0.0_f64);
        for (k, row) in rows.iter().enumerate() {
            let stamp = (k as f64 * number(&run["dT"]) * 1e9).round() as u64;
            filter.step(stamp, Some(&measured(row[z], sd * sd))).unwrap();
            // The recorded filter started with another covariance; that is forgotten after four seconds.
            if k >= 60 {
                let state = filter.state().unwrap();
                worst.0 = worst.0.max((state.position.x - row[x]).abs());
                worst.1 = worst.1.max((state.velocity.x - row[v]).abs());
            }
        }
        // The sequence is printed with six decimals and nine digits.
        assert!(worst.0 < 1e-5 && worst.1 < 1e-4, "sensor {sensor}: {worst:?}");
        let (state, expected) = (filter.state().unwrap(), &run[p]);
        for (found, i, j) in [(state.pp, 0, 0), (state.pv, 0, 1), (state.vv, 1, 1)] {
            let expected = number(&expected[i][j]);
            assert!(
                (found.x / expected - 1.0).abs() < 1e-6,
                "sensor {sensor} P[{i}][{j}]: {} {expected}",
                found.x
            );
        }
    }
}
