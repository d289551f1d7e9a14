//! What the filter does with stamps, gaps, outliers and several channels.

use nalgebra::{Matrix1, Matrix3, SVector, Vector1, Vector3};
use stillpoint_estimate::{
    Counts, Hold, Kalman, KalmanParams, Measurement, Outcome, ProcessNoise, StampError,
};

fn params<const N: usize>() -> KalmanParams<N> {
    KalmanParams {
        process: ProcessNoise::per_step(0.05),
        open_sd: SVector::repeat(1.0),
        initial_velocity_sd: SVector::repeat(0.1),
        gate: 9.0,
        horizon: u64::MAX,
    }
}

const PERIOD: u64 = 33_333_333;

fn at(z: f64) -> Measurement<1> {
    Measurement { position: Vector1::new(z), covariance: Matrix1::new(1e-6) }
}

fn at_3d(z: [f64; 3]) -> Measurement<3> {
    Measurement { position: Vector3::from(z), covariance: Matrix3::from_diagonal_element(1e-6) }
}

fn settled() -> (Kalman<1>, u64) {
    let mut filter = Kalman::new(params()).unwrap();
    for k in 1..=60 {
        filter.step(k * PERIOD, Some(&at(0.5))).unwrap();
    }
    (filter, 60 * PERIOD)
}

#[test]
fn filter_waits_for_its_first_measurement() {
    let mut filter = Kalman::<1>::new(params()).unwrap();
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
fn two_that_agree_beyond_the_gate_begin_the_track_anew() {
    let (mut filter, now) = settled();
    assert!(matches!(filter.step(now + PERIOD, Some(&at(0.52))), Ok(Outcome::Gated(_))));
    assert_eq!(filter.step(now + 2 * PERIOD, Some(&at(0.521))), Ok(Outcome::Started));
    let state = filter.state().unwrap();
    assert!((state.position.x - 0.521).abs() < 1e-3 && filter.run() == 1, "{state:?}");
    // The velocity is that of the two.
    assert!((state.velocity.x - 0.03).abs() < 0.005, "{state:?}");
    assert_eq!(filter.counts(), Counts { used: 61, gated: 1, given_up: 1, ..Counts::default() });
    assert!(matches!(filter.step(now + 3 * PERIOD, Some(&at(0.522))), Ok(Outcome::Updated(_))));
}

#[test]
fn outliers_that_do_not_agree_begin_nothing() {
    let (mut filter, now) = settled();
    for k in 1..=6 {
        let z = 0.5 + if k % 2 == 0 { 0.1 } else { -0.1 };
        assert!(matches!(filter.step(now + k * PERIOD, Some(&at(z))), Ok(Outcome::Gated(_))), "{k}");
    }
    // One that fits the track ends the doubt: the next outlier is alone again.
    assert!(matches!(filter.step(now + 7 * PERIOD, Some(&at(0.5))), Ok(Outcome::Updated(_))));
    assert!(matches!(filter.step(now + 8 * PERIOD, Some(&at(0.6))), Ok(Outcome::Gated(_))));
    assert!((filter.state().unwrap().position.x - 0.5).abs() < 1e-3);
}

/// A cough: 2 mm up and down in 0.4 s, measured to a few micrometres every 100 ms.
#[test]
fn a_head_that_moves_faster_than_was_thought_is_not_lost() {
    let process = ProcessNoise::per_step(0.05);
    let mut filter = Kalman::<1>::new(KalmanParams { process, ..params() }).unwrap();
    let (mut worst, mut gated) = (0.0_f64, 0);
    for k in 1..100_u64 {
        let t = k as f64 * 0.1;
        let since = (t - 5.03) / 0.4;
        let z = if (0.0..1.0).contains(&since) {
            1e-3 * (1.0 - (2.0 * std::f64::consts::PI * since).cos())
        } else {
            0.0
        };
        let z = Measurement { position: Vector1::new(z), covariance: Matrix1::new(9e-12) };
        let outcome = filter.step(k * 100_000_000, Some(&z)).unwrap();
        gated += u32::from(matches!(outcome, Outcome::Gated(_)));
        worst = worst.max((filter.state().unwrap().position.x - z.position.x).abs());
    }
    // Frames that are refused cost about what the head moved meanwhile. (Where a track waits
    // for its horizon instead, 9.9 mm.)
    assert!(gated > 0 && worst < 2.5e-3, "{gated} refused, {worst} m");
}

#[test]
fn measurements_that_are_not_finite_or_without_covariance_are_refused_and_counted() {
    let (mut filter, now) = settled();
    let bad = [
        Measurement { position: Vector1::new(f64::NAN), ..at(0.5) },
        Measurement { covariance: Matrix1::new(f64::NEG_INFINITY), ..at(0.5) },
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
    let mut joint = Kalman::<3>::new(params()).unwrap();
    let mut single = [(); 3].map(|()| Kalman::<1>::new(params()).unwrap());
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
    let mut filter = Kalman::<3>::new(params()).unwrap();
    for k in 1..60 {
        filter.step(k * PERIOD, Some(&at_3d([0.1, 0.2, 0.3]))).unwrap();
    }
    let outcome = filter.step(60 * PERIOD, Some(&at_3d([0.1, 0.25, 0.3]))).unwrap();
    assert!(matches!(outcome, Outcome::Gated(_)));
}

#[test]
fn covariance_stays_symmetric_and_positive_over_a_long_run_of_unequal_steps() {
    let mut filter = Kalman::<3>::new(KalmanParams { gate: f64::INFINITY, ..params() }).unwrap();
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
    let process = ProcessNoise::per_step(f64::NAN);
    assert_eq!(of(KalmanParams { process, ..params() }), "acceleration_sd");
    let process = ProcessNoise { hold: Hold::Seconds(0.0), ..params().process };
    assert_eq!(of(KalmanParams { process, ..params() }), "hold");
    assert_eq!(
        of(KalmanParams { initial_velocity_sd: Vector1::new(-1.0), ..params() }),
        "initial_velocity_sd"
    );
    assert_eq!(of(KalmanParams { open_sd: Vector1::new(f64::INFINITY), ..params() }), "open_sd");
    assert_eq!(of(KalmanParams { gate: 0.0, ..params() }), "gate");
}

#[test]
fn filter_without_a_usable_measurement_for_its_horizon_has_no_state_and_starts_anew() {
    let mut filter = Kalman::<1>::new(KalmanParams { horizon: 10 * PERIOD, ..params() }).unwrap();
    for k in 1..=5 {
        filter.step(k * PERIOD, Some(&at(0.5))).unwrap();
    }
    // Gated measurements do not count: it would predict for ever.
    for k in 6..=15 {
        filter.step(k * PERIOD, Some(&at(if k % 2 == 0 { 0.9 } else { 1.9 }))).unwrap();
        assert!(filter.state().is_some(), "{k}");
    }
    assert!(filter.predicted_to(15 * PERIOD).is_some() && filter.predicted_to(15 * PERIOD + 1).is_none());
    assert_eq!(filter.step(16 * PERIOD, Some(&at(0.9))), Ok(Outcome::Started));
    assert_eq!((filter.state().unwrap().position.x, filter.run()), (0.9, 1));
    assert_eq!(filter.counts(), Counts { used: 6, gated: 10, given_up: 1, ..Counts::default() });
    assert_eq!(filter.step(27 * PERIOD, None), Ok(Outcome::Waiting));
    assert_eq!(filter.state(), None);
}

#[test]
fn held_acceleration_means_the_same_in_one_step_as_in_two() {
    let q = ProcessNoise { hold: Hold::Seconds(0.033), acceleration_sd: Vector1::new(0.1) };
    let start = *settled().0.state().unwrap();
    let once = start.predicted(0.066, &q);
    let twice = start.predicted(0.020, &q).predicted(0.046, &q);
    for (a, b) in [(once.pp, twice.pp), (once.pv, twice.pv), (once.vv, twice.vv)] {
        assert!((a.x / b.x - 1.0).abs() < 1e-12, "{a} {b}");
    }
    // Per step (4.6), twice the time is not twice one step.
    let q = ProcessNoise::per_step(0.1);
    let (once, twice) = (start.predicted(0.066, &q), start.predicted(0.033, &q).predicted(0.033, &q));
    assert!((once.vv - start.vv).x > 1.9 * (twice.vv - start.vv).x);
}

#[test]
fn open_channels_are_not_updated_whatever_their_numbers() {
    let mut filter = Kalman::<3>::new(params()).unwrap();
    let mut height = Kalman::<1>::new(params()).unwrap();
    let mut covariance = Matrix3::from_diagonal_element(f64::INFINITY);
    covariance[(2, 2)] = 1e-6;
    for k in 1..60_u64 {
        let z = 0.3 + 0.001 * ((k * 7) % 5) as f64;
        let measured = Measurement { position: Vector3::new(f64::NAN, k as f64, z), covariance };
        filter.step(k * PERIOD, Some(&measured)).unwrap();
        height.step(k * PERIOD, Some(&at(z))).unwrap();
    }
    let (state, alone) = (filter.state().unwrap(), height.state().unwrap());
    assert_eq!((state.position.x, state.position.y), (0.0, 0.0));
    assert!(state.pp[(0, 0)] >= 1.0 && state.pp[(1, 1)] >= 1.0);
    assert_eq!(filter.counts(), height.counts());
    assert!((state.position.z - alone.position.x).abs() < 1e-12);
    assert!((state.pp[(2, 2)] / alone.pp.x - 1.0).abs() < 1e-9);
    // A channel that is measured later takes the measurement as it is.
    let open = Measurement {
        position: Vector3::new(5.0, 0.0, 0.0),
        covariance: Matrix3::from_diagonal(&Vector3::new(1e-6, f64::INFINITY, f64::INFINITY)),
    };
    let mut far = Kalman::<3>::new(KalmanParams { gate: 1e9, ..params() }).unwrap();
    far.step(1, Some(&Measurement { position: Vector3::zeros(), covariance })).unwrap();
    far.step(PERIOD, Some(&open)).unwrap();
    assert!((far.state().unwrap().position.x - 5.0).abs() < 1e-4);
}

#[test]
fn measurement_of_nothing_is_refused() {
    let (mut filter, now) = settled();
    let nothing = Measurement { covariance: Matrix1::new(f64::INFINITY), ..at(0.5) };
    assert_eq!(filter.step(now + PERIOD, Some(&nothing)), Ok(Outcome::Refused));
}
