//! Reference model, adaptive laws, projection and valve allocation against the vectors, and what they are for.

use nalgebra::{DMatrix, SMatrix, SVector};
use proptest::prelude::*;
use serde_json::Value;
use stillpoint_control::adaptive::{Column, Gains, Law};
use stillpoint_control::projection::{Ball, projected};
use stillpoint_control::reference::{ReferenceModel, pole_of_rise};
use stillpoint_control::valves::split;
use stillpoint_mechanics::dormand_prince;

use super::vectors::{
    assert_all_close, assert_close, assert_matrix_close, cases, matrix, number, numbers, vector, vectors,
};

#[test]
fn the_reference_model_follows_the_vectors() {
    for case in cases(vectors!("e_reference_model")) {
        let a = number(&case["in"]["a"]);
        assert!((pole_of_rise(20.0) - a).abs() < 1e-15);
        let target = numbers(&case["in"]["y_des"]);
        for (t, expected) in numbers(&case["in"]["t"]).into_iter().zip(case["out"]["y_m"].as_array().unwrap())
        {
            let mut model = ReferenceModel::new(a, 3);
            model.start_at(&numbers(&case["in"]["y0"]));
            model.advance(&target, t);
            assert_all_close(&case, "y_m", model.at(), expected);
        }
        for (name, part) in [("t10", 0.1), ("t90", 0.9)] {
            let mut model = ReferenceModel::new(a, 1);
            model.advance(&[1.0], number(&case["out"][name]));
            assert_close(&case, name, model.at()[0], part);
        }
    }
}

#[test]
fn projection_follows_the_vectors() {
    for case in cases(vectors!("e_projection")) {
        let (theta, update) = (vector::<4>(&case["in"]["theta"]), vector::<4>(&case["in"]["update"]));
        let ball = Ball { radius: number(&case["in"]["theta_max"]), shell: number(&case["in"]["eps"]) };
        let found = projected(&theta, &update, &ball);
        assert_all_close(&case, "projected", found.as_slice(), &case["out"]["projected"]);
    }
}

#[test]
fn valve_allocation_follows_the_vectors() {
    for case in cases(vectors!("e_valve_allocation")) {
        let net = numbers(&case["in"]["v"]);
        let mut duty = vec![0.0; 2 * net.len()];
        let _ = split(&net, &mut duty);
        assert_all_close(&case, "u_in_out", &duty, &case["out"]["u_in_out"]);
    }
}

/// Pose, reference model and the gains K_y, K_r and Theta over three, six and six numbers for six inputs.
const STATE: usize = 3 + 3 + 6 * (3 + 6 + 6);

/// The plant (4.23), its reference model and its gains as one differential equation, with all gains from the crate's law.
struct Run {
    a: SMatrix<f64, 3, 3>,
    b: SMatrix<f64, 3, 6>,
    lambda: SVector<f64, 6>,
    theta: SMatrix<f64, 6, 6>,
    laws: [Law; 3],
    p: f64,
    pole: f64,
    target: SVector<f64, 3>,
    mask: SVector<f64, 6>,
    amplitude: SVector<f64, 3>,
}

impl Run {
    fn of(case: &Value) -> Self {
        let given = &case["in"];
        let pole = number(&given["a"]);
        let sigma = number(&given["sigma"]);
        let law = |name: &str| {
            let learning = number(&given[name]);
            Law { learning, leak: sigma * learning, ball: None }
        };
        let b: DMatrix<f64> = matrix(&given["B"]);
        let theta = matrix(&given["Theta"]);
        Self {
            a: SMatrix::from_iterator(matrix(&given["A"]).iter().copied()),
            b: SMatrix::from_iterator(b.iter().copied()),
            lambda: vector(&given["Lambda"]),
            theta: SMatrix::from_iterator(theta.iter().copied()),
            laws: ["gamma_y", "gamma_r", "gamma_theta"].map(law),
            p: 50.0 / pole,
            pole,
            target: vector(&given["y_des"]),
            mask: vector(&given["basis_mask"]),
            amplitude: vector(&given["w_amp"]),
        }
    }

    fn slope(&self, t: f64, state: &SVector<f64, STATE>) -> SVector<f64, STATE> {
        let y: SVector<f64, 3> = state.fixed_rows::<3>(0).into_owned();
        let model: SVector<f64, 3> = state.fixed_rows::<3>(3).into_owned();
        let reference = self.b.transpose() * self.target;
        let all = [1.0, libm::tanh(y[0]), libm::tanh(y[1]), libm::tanh(y[2]), y[0] * y[1], y[1] * y[2]];
        let truth = SVector::<f64, 6>::from(all);
        let phi = truth.component_mul(&self.mask);
        let wind = SVector::<f64, 3>::new(libm::sin(0.9 * t), libm::cos(1.3 * t), libm::sin(2.1 * t + 1.0))
            .component_mul(&self.amplitude);
        let e = y - model;
        let drives =
            (e.transpose() * self.b * self.p).transpose().component_mul(&self.lambda.map(f64::signum));
        let regressors = [padded(y.as_slice()), padded(reference.as_slice()), padded(phi.as_slice())];
        let mut slope = SVector::<f64, STATE>::zeros();
        let mut u = SVector::<f64, 6>::zeros();
        let mut at = 6;
        for ((law, regressor), many) in self.laws.iter().zip(&regressors).zip([3, 6, 6]) {
            for j in 0..6 {
                let gains = padded(&state.as_slice()[at..at + many]);
                u[j] += gains.dot(regressor);
                let rate = law.rate(&gains, regressor, drives[j]);
                slope.as_mut_slice()[at..at + many].copy_from_slice(&rate.as_slice()[..many]);
                at += many;
            }
        }
        let f = self.theta.transpose() * truth;
        let moved = self.a * y + self.b * (u - f).component_mul(&self.lambda) + wind;
        slope.fixed_rows_mut::<3>(0).copy_from(&moved);
        slope.fixed_rows_mut::<3>(3).copy_from(&((self.target - model) * self.pole));
        slope
    }
}

fn padded(numbers: &[f64]) -> Column {
    let mut column = Column::zeros();
    column.as_mut_slice()[..numbers.len()].copy_from_slice(numbers);
    column
}

#[test]
fn adaptive_loops_follow_their_reference_trajectories() {
    for case in cases(vectors!("e_mrac_traj")) {
        let run = Run::of(&case);
        let mut state = SVector::<f64, STATE>::zeros();
        state.fixed_rows_mut::<3>(0).copy_from(&vector::<3>(&case["in"]["y0"]));
        state.fixed_rows_mut::<3>(3).copy_from(&vector::<3>(&case["in"]["y0"]));
        let (h, out) = (0.01, &case["out"]);
        let times = numbers(&out["t"]);
        let every = (number(&case["in"]["dt_out"]) / h).round() as usize;
        for k in 0..times.len() {
            assert_all_close(&case, &format!("y at {} s", times[k]), &state.as_slice()[..3], &out["y"][k]);
            assert_all_close(
                &case,
                &format!("y_m at {} s", times[k]),
                &state.as_slice()[3..6],
                &out["y_m"][k],
            );
            for i in 0..every {
                let t = times[k] + i as f64 * h;
                state = dormand_prince::step(|t, y| run.slope(t, y), t, &state, h).state;
            }
            if k + 2 == times.len() {
                // The last row of the file is the end: gains are compared there.
                let gains = |at: usize, many: usize| {
                    DMatrix::from_column_slice(many, 6, &state.as_slice()[at..at + 6 * many])
                };
                assert_matrix_close(&case, "Ky_end", &gains(6, 3), &out["Ky_end"]);
                assert_matrix_close(&case, "Kr_end", &gains(24, 6), &out["Kr_end"]);
                assert_matrix_close(&case, "Theta_end", &gains(60, 6), &out["Theta_end"]);
            }
        }
    }
}

#[test]
fn without_a_leak_noise_lets_gains_drift_and_with_one_they_come_back() {
    let norm = |leak: f64| {
        let mut gains = Gains::new(Law { learning: 0.1, leak, ball: None }, 1);
        for k in 0..20_000 {
            // An error of the sign of its regressor, as noise in the pose makes it.
            let noise = if k % 2 == 0 { 0.1 } else { -0.1 };
            gains.adapt(&padded(&[noise]), &[noise], 0.1);
        }
        gains.norm()
    };
    assert!((norm(0.0) - 2.0).abs() < 1e-9, "{}", norm(0.0));
    assert!((norm(0.02) - 0.05).abs() < 1e-6, "{}", norm(0.02));
}

proptest! {
    #[test]
    fn projected_gains_never_leave_their_ball(
        drives in prop::collection::vec((-1e3..1e3, prop::array::uniform4(-1.0..1.0)), 1..200),
        radius in 0.01..10.0,
    ) {
        let law = Law { learning: 0.5, leak: 0.0, ball: Some(Ball { radius, shell: 0.1 }) };
        let mut gains = Gains::new(law, 1);
        for (drive, regressor) in drives {
            // Steps in which the gains change little against the ball.
            let speed = 0.5 * libm::fabs(drive) * 2.0;
            for _ in 0..20 {
                gains.adapt(&padded(&regressor), &[drive], 0.01 * radius / speed.max(1e-6));
                prop_assert!(gains.norm() <= radius * (1.0 + 1e-6), "{} {radius}", gains.norm());
            }
        }
    }
}
