//! Riccati and Lyapunov equations, and linear-quadratic control along its reference trajectory.

use nalgebra::{DMatrix, dmatrix};
use proptest::prelude::*;
use stillpoint_control::lqi::{Lqi, LqiError, Plant, Weights};
use stillpoint_control::lyapunov::{LyapunovError, lyapunov};
use stillpoint_control::riccati::{Regulator, RiccatiError, dlqr, observer_gain, spectral_radius};

use super::vectors::{assert_close, assert_matrix_close, cases, matrix, number, numbers, vectors};

#[test]
fn riccati_gains_follow_the_vectors() {
    for case in cases(vectors!("d_dlqr")) {
        let [a, b, q, r, n] = ["A", "B", "Q", "R", "N"].map(|name| matrix(&case["in"][name]));
        let solution = dlqr(&Regulator { a: &a, b: &b, q: &q, r: &r, n: Some(&n) }).unwrap();
        assert_matrix_close(&case, "P", &solution.p, &case["out"]["P"]);
        assert_matrix_close(&case, "K", &solution.k, &case["out"]["K"]);
        let radius = spectral_radius(&(a - b * solution.k));
        assert_close(&case, "radius", radius, number(&case["out"]["closed_loop_spectral_radius"]));
    }
}

#[test]
fn lyapunov_solutions_follow_the_vectors() {
    for case in cases(vectors!("e_lyapunov")) {
        let p = lyapunov(&matrix(&case["in"]["A_m"]), &matrix(&case["in"]["Q"])).unwrap();
        assert_matrix_close(&case, "P", &p, &case["out"]["P"]);
        let least = p.symmetric_eigenvalues().min();
        assert_close(&case, "least eigenvalue", least, number(&case["out"]["min_eig_P"]));
    }
}

#[test]
fn the_lqi_loop_follows_its_reference_trajectory() {
    for case in cases(vectors!("d_lqi_traj")) {
        let given = &case["in"];
        let [a, b, c, k] = ["A", "B", "C", "K_obs"].map(|name| matrix(&given[name]));
        let q = matrix(&given["Qaug"]);
        let n = a.nrows();
        let weights = Weights {
            state: q.view((0, 0), (n, n)).into_owned(),
            integral: q.view((n, n), (1, 1)).into_owned(),
            effort: matrix(&given["R"]),
        };
        let plant = Plant { a: a.clone(), b: b.clone(), c: c.clone(), k };
        let mut law = Lqi::design(plant, &weights).unwrap();
        law.limit([f64::NEG_INFINITY, f64::INFINITY]);
        assert_matrix_close(&case, "L_aug", law.gain(), &case["out"]["L_aug"]);
        let push = DMatrix::from_column_slice(n, 1, &numbers(&given["state_disturbance"]));
        let mut x = DMatrix::zeros(n, 1);
        let (ys, us) = (numbers(&case["out"]["y"]), numbers(&case["out"]["u"]));
        for (step, expected) in ys.iter().enumerate() {
            let y = (&c * &x)[0];
            assert_close(&case, &format!("y[{step}]"), y, *expected);
            let mut u = [0.0];
            law.step(&[y], &[number(&given["r"])], &mut u);
            if let Some(expected) = us.get(step) {
                assert_close(&case, &format!("u[{step}]"), u[0], *expected);
            }
            x = &a * &x + &b * u[0] + &push;
        }
    }
}

#[test]
fn a_plant_at_the_resting_state_of_its_set_point_is_left_alone_and_one_that_follows_is_fed() {
    let (a, b, c) = (dmatrix![1.0, 0.3; 0.0, 0.8], dmatrix![0.0; 0.2], dmatrix![1.0, 0.0]);
    let plant = Plant { a: a.clone(), b: b.clone(), c, k: dmatrix![0.5; 0.1] };
    let weights = Weights { state: DMatrix::identity(2, 2), integral: dmatrix![0.01], effort: dmatrix![0.1] };
    let mut law = Lqi::design(plant, &weights).unwrap();
    law.restart(&[3.0, 0.0]);
    law.aim(&[3.0, 0.0]);
    let mut u = [9.0];
    for _ in 0..10 {
        law.step(&[3.0], &[3.0], &mut u);
        assert!(u[0].abs() < 1e-12, "{u:?}");
    }
    // The set-point moves by 0.06 a sample: v = 0.2, u = v. Nothing is left for gain and integrator.
    let mut x = dmatrix![3.0; 0.2];
    law.restart(x.as_slice());
    for k in 0..50 {
        let r = 3.0 + 0.06 * f64::from(k);
        law.aim(&[r, 0.2]);
        law.feed(&[0.2]);
        law.step(&[x[0]], &[r], &mut u);
        assert!((u[0] - 0.2).abs() < 1e-9, "{k}: {u:?}");
        x = &a * &x + &b * u[0];
    }
    assert!(law.integral()[0].abs() < 1e-9);
}

#[test]
fn a_limited_input_does_not_wind_the_integrator_up() {
    let plant = Plant { a: dmatrix![1.0], b: dmatrix![0.01], c: dmatrix![1.0], k: dmatrix![0.6] };
    let weights = Weights { state: dmatrix![1.0], integral: dmatrix![0.01], effort: dmatrix![0.1] };
    let mut law = Lqi::design(plant, &weights).unwrap();
    let (mut y, mut u, mut highest) = (0.0_f64, [0.0], 0.0_f64);
    for _ in 0..2000 {
        law.step(&[y], &[5.0], &mut u);
        assert!(u[0].abs() <= 1.0);
        y += 0.01 * u[0];
        highest = highest.max(y);
    }
    assert!(highest < 5.5 && (y - 5.0).abs() < 1e-6, "highest {highest}, at last {y}");
}

#[test]
fn the_observer_gain_is_the_steady_kalman_gain() {
    let (a, c) = (dmatrix![1.0, 0.1; 0.0, 1.0], dmatrix![1.0, 0.0]);
    let (w, v) = (dmatrix![1e-4, 0.0; 0.0, 1e-2], dmatrix![1e-2]);
    let k = observer_gain(&a, &c, &w, &v).unwrap();
    let mut p = DMatrix::<f64>::identity(2, 2);
    for _ in 0..10_000 {
        let s = (&c * &p * c.transpose() + &v)[0];
        let gain = &p * c.transpose() / s;
        p = &a * (&p - &gain * &c * &p) * a.transpose() + &w;
    }
    let s = (&c * &p * c.transpose() + &v)[0];
    let expected = &a * &p * c.transpose() / s;
    assert!((k - expected).norm() < 1e-10);
}

#[test]
fn what_cannot_be_solved_is_refused_with_its_reason() {
    let one = dmatrix![1.0];
    let solve = |a: f64, b: f64, q: f64, r: f64| {
        dlqr(&Regulator { a: &dmatrix![a], b: &dmatrix![b], q: &dmatrix![q], r: &dmatrix![r], n: None })
    };
    assert!(matches!(solve(1.5, 0.0, 1.0, 1.0), Err(RiccatiError::NotStabilisable { .. })));
    assert!(matches!(solve(1.0, 0.0, 1.0, 1.0), Err(RiccatiError::NotStabilisable { .. })));
    assert_eq!(solve(0.5, 1.0, 1.0, 0.0), Err(RiccatiError::FreeInput));
    assert_eq!(solve(0.5, 1.0, -1.0, 1.0), Err(RiccatiError::NegativeCost));
    assert_eq!(solve(f64::NAN, 1.0, 1.0, 1.0), Err(RiccatiError::NotFinite("A")));
    let shape = dlqr(&Regulator { a: &one, b: &dmatrix![1.0; 2.0], q: &one, r: &one, n: None });
    assert!(matches!(shape, Err(RiccatiError::Shape { what: "B", rows: 2, .. })));
    assert_eq!(lyapunov(&dmatrix![0.1], &one), Err(LyapunovError::NotPositive));
    assert_eq!(lyapunov(&dmatrix![0.0], &one), Err(LyapunovError::NotPositive));
    assert_eq!(lyapunov(&dmatrix![-1.0, 0.0], &one), Err(LyapunovError::Shape));
    let plant = Plant { a: dmatrix![1.0], b: one.clone(), c: one.clone(), k: dmatrix![-0.5] };
    let weights = Weights { state: one.clone(), integral: one.clone(), effort: one };
    assert!(matches!(Lqi::design(plant, &weights).map(|_| ()), Err(LqiError::Observer { .. })));
}

fn entries(n: usize, range: std::ops::Range<f64>) -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(range, n)
}

proptest! {
    #[test]
    fn a_gain_leaves_the_equation_balanced_and_the_loop_stable(
        a in entries(9, -1.2..1.2), b in entries(6, -1.0..1.0), root in entries(9, -1.0..1.0), r in 1e-3..1e3,
    ) {
        let a = DMatrix::from_row_slice(3, 3, &a);
        let b = DMatrix::from_row_slice(3, 2, &b);
        let root = DMatrix::from_row_slice(3, 3, &root);
        let q = &root * root.transpose() + DMatrix::identity(3, 3) * 0.01;
        let r = DMatrix::identity(2, 2) * r;
        // A pair that is all but out of reach of the input has a P as large as you like.
        if let Ok(found) = dlqr(&Regulator { a: &a, b: &b, q: &q, r: &r, n: None }) {
            prop_assert!(spectral_radius(&(&a - &b * &found.k)) < 1.0);
            let p = &found.p;
            let across = a.transpose() * p * &b;
            let repeated = a.transpose() * p * &a + &q - &across * &found.k;
            prop_assert!((repeated - p).norm() <= 1e-8 * p.norm(), "{}", p);
        }
    }
}
