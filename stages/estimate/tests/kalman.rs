//! What the filter does with stamps, gaps, outliers and several channels.

#![allow(clippy::unwrap_used, clippy::panic)]

use nalgebra::{Matrix1, Matrix3, Vector1, Vector3};
use stillpoint_estimate::{Counts, Kalman, KalmanParams, Measurement, Outcome, StampError};

const PARAMS: KalmanParams = KalmanParams { acceleration_sd: 0.05, initial_velocity_sd: 0.1, gate: 9.0 };
const PERIOD: u64 = 33_333_333;

fn at(z: f64) -> Measurement<1> {
    Measurement { position: Vector1::new(z), covariance: Matrix1::new(1e-6) }
}

fn at_3d(z: [f64; 3]) -> Measurement<3> {
    Measurement { position: Vector3::from(z), covariance: Matrix3::from_diagonal_element(1e-6) }
}

fn settled() -> (Kalman<1>, u64) {
    let mut filter = Kalman::new(PARAMS).unwrap();
    for k in 1..=60 {
        filter.step(k * PERIOD, Some(&at(0.5))).unwrap();
    }
    (filter, 60 * PERIOD)
}

#[test]
fn filter_waits_for_its_first_measurement() {
    let mut filter = Kalman::<1>::new(PARAMS).unwrap();
    assert_eq!(filter.step(5, None), Ok(Outcome::Waiting));
    assert_eq!(filter.state(), None);
    assert_eq!(filter.step(9, Some(&at(0.5))), Ok(Outcome::Started));
    assert_eq!(filter.state().unwrap().position.x, 0.5);
}

#[test]
fn missing_frame_predicts_only_and_widens_the_covariance() {
    let (mut filter, now) = settled();
    let before = *filter.state().unwrap();
    assert_eq!(filter.step(now + PERIOD, None), Ok(Outcome::Predicted));
    let after = filter.state().unwrap();
    let dt = PERIOD as f64 * 1e-9;
    assert_eq!(after.position, before.position + before.velocity * dt);
    assert!(after.pp.x > before.pp.x && after.vv.x > before.vv.x);
    assert_eq!(filter.counts().missing, 1);
}

#[test]
fn one_long_step_carries_position_as_two_short_ones() {
    let (filter, now) = settled();
    let (mut once, mut twice) = (filter.clone(), filter);
    once.step(now + 2 * PERIOD, None).unwrap();
    twice.step(now + PERIOD, None).unwrap();
    twice.step(now + 2 * PERIOD, None).unwrap();
    let (a, b) = (once.state().unwrap(), twice.state().unwrap());
    assert!((a.position.x - b.position.x).abs() < 1e-15);
}

#[test]
fn innovation_beyond_the_gate_is_counted_and_not_used() {
    let (mut filter, now) = settled();
    let outcome = filter.step(now + PERIOD, Some(&at(0.6))).unwrap();
    assert!(matches!(outcome, Outcome::Gated(i) if i.exceeds(9.0)), "{outcome:?}");
    assert!((filter.state().unwrap().position.x - 0.5).abs() < 1e-6);
    assert_eq!(filter.counts(), Counts { used: 60, gated: 1, ..Counts::default() });
}

#[test]
fn true_jump_is_followed_once_the_covariance_has_grown() {
    let (mut filter, now) = settled();
    let mut frames = 0;
    while (filter.state().unwrap().position.x - 0.52).abs() > 1e-3 {
        frames += 1;
        assert!(frames < 90, "still at {}", filter.state().unwrap().position.x);
        filter.step(now + frames * PERIOD, Some(&at(0.52))).unwrap();
    }
    assert!(filter.counts().gated > 0);
}

#[test]
fn measurements_that_are_not_finite_or_without_covariance_are_refused_and_counted() {
    let (mut filter, now) = settled();
    let bad = [
        Measurement { position: Vector1::new(f64::NAN), ..at(0.5) },
        Measurement { covariance: Matrix1::new(f64::INFINITY), ..at(0.5) },
        Measurement { covariance: Matrix1::new(0.0), ..at(0.5) },
        Measurement { covariance: Matrix1::new(-1.0), ..at(0.5) },
    ];
    for (k, z) in (1..).zip(&bad) {
        assert_eq!(filter.step(now + k * PERIOD, Some(z)), Ok(Outcome::Refused));
    }
    assert_eq!(filter.counts().refused, 4);
    assert!(filter.state().unwrap().position.x.is_finite());
}

#[test]
fn stamp_that_does_not_increase_is_refused_and_changes_nothing() {
    let (mut filter, now) = settled();
    let before = filter.state().copied();
    for found in [now, now - 1, 0] {
        assert_eq!(filter.step(found, Some(&at(0.7))), Err(StampError { last: now, found }));
    }
    assert_eq!(filter.state().copied(), before);
    assert_eq!((filter.counts().stale, filter.stamp()), (3, Some(now)));
}

#[test]
fn independent_channels_are_as_many_single_filters() {
    let mut joint = Kalman::<3>::new(PARAMS).unwrap();
    let mut single = [(); 3].map(|()| Kalman::<1>::new(PARAMS).unwrap());
    for k in 1..200_u64 {
        let t = k as f64 / 30.0;
        let z = [0.001 * t, 0.5 + 0.0003 * ((k * 7) % 5) as f64, -0.002 * t * t / 50.0];
        joint.step(k * PERIOD, Some(&at_3d(z))).unwrap();
        for (filter, z) in single.iter_mut().zip(z) {
            filter.step(k * PERIOD, Some(&at(z))).unwrap();
        }
    }
    assert_eq!(joint.counts(), single[0].counts());
    let state = joint.state().unwrap();
    for (i, filter) in single.iter().enumerate() {
        let alone = filter.state().unwrap();
        assert!((state.position[i] - alone.position.x).abs() < 1e-12);
        assert!((state.velocity[i] - alone.velocity.x).abs() < 1e-12);
        assert!((state.vv[(i, i)] - alone.vv.x).abs() < 1e-12);
    }
}

#[test]
fn one_bad_channel_gates_the_whole_measurement() {
    let mut filter = Kalman::<3>::new(PARAMS).unwrap();
    for k in 1..60 {
        filter.step(k * PERIOD, Some(&at_3d([0.1, 0.2, 0.3]))).unwrap();
    }
    let outcome = filter.step(60 * PERIOD, Some(&at_3d([0.1, 0.25, 0.3]))).unwrap();
    assert!(matches!(outcome, Outcome::Gated(_)));
}

#[test]
fn covariance_stays_symmetric_and_positive_over_a_long_run_of_unequal_steps() {
    let mut filter = Kalman::<3>::new(KalmanParams { gate: f64::INFINITY, ..PARAMS }).unwrap();
    let correlated = Matrix3::new(4e-6, 3e-6, 0.0, 3e-6, 4e-6, 1e-6, 0.0, 1e-6, 1e-6);
    let mut stamp = 0;
    for k in 1..20_000_u64 {
        stamp += 1_000_000 + (k * 7919 % 65) * 1_000_000;
        let z = Measurement { position: Vector3::new(0.1, 0.2, 0.3), covariance: correlated };
        filter.step(stamp, (k % 3 != 0).then_some(&z)).unwrap();
        let s = filter.state().unwrap();
        assert!(s.pp.cholesky().is_some() && s.vv.cholesky().is_some(), "step {k}");
        assert_eq!((s.pp - s.pp.transpose()).norm(), 0.0);
    }
}

#[test]
fn parameters_outside_their_range_are_refused_by_name() {
    let of = |params| Kalman::<1>::new(params).unwrap_err().name;
    assert_eq!(of(KalmanParams { acceleration_sd: f64::NAN, ..PARAMS }), "acceleration_sd");
    assert_eq!(of(KalmanParams { initial_velocity_sd: -1.0, ..PARAMS }), "initial_velocity_sd");
    assert_eq!(of(KalmanParams { gate: 0.0, ..PARAMS }), "gate");
}
