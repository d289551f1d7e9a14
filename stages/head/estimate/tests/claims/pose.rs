//! The filter of a pose: an error state about a mean that turns.

use nalgebra::{Isometry3, Matrix6, SVector, Vector3, Vector6};
use stillpoint_estimate::{Kalman, KalmanParams, Manifold, Measurement, Outcome, ProcessNoise};

use stillpoint_mechanics::random::Random;

const PERIOD: u64 = 33_333_333;

fn filter(acceleration_sd: f64) -> Kalman<6, Isometry3<f64>> {
    Kalman::new(KalmanParams {
        process: ProcessNoise::per_step(acceleration_sd),
        open_sd: SVector::repeat(1.0),
        initial_velocity_sd: SVector::repeat(0.5),
        gate: f64::INFINITY,
        horizon: u64::MAX,
    })
    .unwrap()
}

fn of(numbers: [f64; 6]) -> Isometry3<f64> {
    Isometry3::origin().plus(&Vector6::from(numbers))
}

#[test]
fn head_that_turns_evenly_is_followed_without_lag() {
    let mut filter = filter(0.5);
    let covariance = Matrix6::from_diagonal_element(1e-6);
    let (mut pose, rate) =
        (of([0.1, 0.2, 0.3, 0.4, -0.3, 0.2]), Vector6::new(0.01, 0.0, -0.02, 0.2, 0.1, -0.3));
    for k in 0..300 {
        pose = pose.plus(&(rate * PERIOD as f64 * 1e-9));
        filter.step(k * PERIOD, Some(&Measurement { position: pose, covariance })).unwrap();
    }
    let state = filter.state().unwrap();
    assert!(state.position.minus(&pose).norm() < 1e-5, "{}", state.position.minus(&pose));
    assert!((state.velocity - rate).norm() < 1e-3, "{}", state.velocity);
}

#[test]
fn rotation_errors_have_the_covariance_that_the_filter_claims() {
    let mut filter = filter(0.3);
    let mut random = Random::new(3);
    let dt = PERIOD as f64 * 1e-9;
    let (mut pose, mut rate) = (of([0.0, 0.0, 0.0, 1.0, 0.5, -0.7]), Vector6::zeros());
    let covariance = Matrix6::from_diagonal_element(4e-6);
    let (mut squares, mut claimed, steps) = (0.0, 0.0, 4000);
    for k in 0..steps + 100 {
        let acceleration = Vector6::from_fn(|_, _| 0.3 * random.normal()) - rate * 0.2;
        pose = pose.plus(&(rate * dt + acceleration * (0.5 * dt * dt)));
        rate += acceleration * dt;
        let measured = pose.plus(&Vector6::from_fn(|_, _| 2e-3 * random.normal()));
        filter.step(k * PERIOD, Some(&Measurement { position: measured, covariance })).unwrap();
        if k >= 100 {
            let state = filter.state().unwrap();
            let error = state.position.minus(&pose);
            squares += error.fixed_rows::<3>(3).norm_squared();
            claimed += state.pp.fixed_view::<3, 3>(3, 3).trace();
        }
    }
    assert!((squares / claimed - 1.0).abs() < 0.1, "actual over claimed {}", squares / claimed);
}

#[test]
fn roll_that_is_not_seen_keeps_its_uncertainty_while_the_rest_settles() {
    let mut filter = filter(0.1);
    let mut covariance = Matrix6::from_diagonal_element(1e-6);
    covariance[(4, 4)] = f64::INFINITY;
    for k in 0..60 {
        let z = Measurement { position: of([0.1, 0.0, 0.0, 0.2, 0.9, 0.1]), covariance };
        assert!(!matches!(filter.step(k * PERIOD, Some(&z)).unwrap(), Outcome::Refused));
    }
    let state = filter.state().unwrap();
    assert!(state.pp[(4, 4)] > 1.0 && state.pp[(3, 3)] < 1e-6 && state.pp[(0, 0)] < 1e-6);
    assert!((state.position.translation.vector - Vector3::new(0.1, 0.0, 0.0)).norm() < 1e-6);
}

#[test]
fn a_pose_that_does_not_turn_is_filtered_as_a_position() {
    let (mut pose, mut position) = (
        filter(0.1),
        Kalman::<3>::new(KalmanParams {
            process: ProcessNoise::per_step(0.1),
            open_sd: Vector3::repeat(1.0),
            initial_velocity_sd: Vector3::repeat(0.5),
            gate: f64::INFINITY,
            horizon: u64::MAX,
        })
        .unwrap(),
    );
    let mut random = Random::new(5);
    for k in 0..100 {
        let at = Vector3::from_fn(|_, _| 1e-3 * random.normal());
        let (six, three) =
            (Matrix6::from_diagonal_element(1e-6), nalgebra::Matrix3::from_diagonal_element(1e-6));
        pose.step(
            k * PERIOD,
            Some(&Measurement {
                position: Isometry3::from_parts(at.into(), nalgebra::UnitQuaternion::identity()),
                covariance: six,
            }),
        )
        .unwrap();
        position.step(k * PERIOD, Some(&Measurement { position: at, covariance: three })).unwrap();
    }
    let (a, b) = (pose.state().unwrap(), position.state().unwrap());
    assert!((a.position.translation.vector - b.position).norm() < 1e-15);
    assert!((a.velocity.fixed_rows::<3>(0) - b.velocity).norm() < 1e-12);
}
