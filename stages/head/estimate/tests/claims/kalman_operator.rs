//! `estimate.kalman` on a bench.

use proptest::prelude::*;

use stillpoint_operator::files::MemoryFiles;
use stillpoint_samples::{
    Diagnostics, Pose, PoseElement, PoseReport, PoseReportElement, Standing, Track, TrackElement,
};
use stillpoint_testing::Bench;
use stillpoint_testing::bench::Left;

use stillpoint_mechanics::random::Random;

const TEXT: &str = "
stillpoint: 1
name: estimate
frames: { camera: { parent: couch, at: [0 m, 0 m, 1 m] } }
operators:
  feed: { use: feed.pose, frame: couch }
  filter: { use: estimate.kalman, inputs: { measurement: { from: feed.out, queue: 4 } }, params: { gate: 25 } }
";

fn bench(text: &str) -> Bench {
    Bench::new(text, "filter", stillpoint_estimate::STAGES, &MemoryFiles::default()).unwrap()
}

fn pose(position: [f64; 3], sd: f64) -> PoseElement {
    let mut covariance = [0.0; 36];
    for i in 0..3 {
        covariance[7 * i] = sd * sd;
        covariance[7 * (i + 3)] = f64::INFINITY;
    }
    PoseElement { position, orientation: [1.0, 0.0, 0.0, 0.0], covariance }
}

fn feed_aged(bench: &mut Bench, pose: PoseElement, age: i64) -> Option<TrackElement> {
    let left = bench.feed::<Pose>(0, &(), &[pose], age);
    assert_eq!(left.fault, None);
    track(&left)
}

fn track(left: &Left) -> Option<TrackElement> {
    let (_, sent) = left.outputs.iter().find(|(port, _)| *port == 0)?;
    Some(*sent.pieces().view::<Track>().unwrap().first().unwrap())
}

fn metric(left: &Left, name: &str) -> f64 {
    let (_, sent) = left.outputs.iter().find(|(port, _)| *port == 1).unwrap();
    let view = sent.pieces().view::<Diagnostics>().unwrap();
    view.elements.iter().find(|m| m.name() == name).unwrap_or_else(|| panic!("no {name}")).value
}

fn feed(bench: &mut Bench, pose: PoseElement) -> Option<TrackElement> {
    feed_aged(bench, pose, 0)
}

const REPORTED: &str = "
stillpoint: 1
name: estimate
frames: { camera: { parent: couch, at: [0 m, 0 m, 1 m] } }
operators:
  feed: { use: feed.pose, frame: couch }
  told: { use: feed.report }
  filter: { use: estimate.kalman, inputs: { measurement: { from: feed.out, queue: 4 }, report: told.out } }
";

/// How much later the second sample of a frame comes, ns.
const LATER: i64 = 10_000_000;

fn report(bench: &mut Bench, reference: u32, age: i64) -> Option<TrackElement> {
    let reported = PoseReportElement { reference, ..zerocopy::FromZeros::new_zeroed() };
    let left = bench.feed::<PoseReport>(2, &(), &[reported], age);
    assert_eq!(left.fault, None);
    track(&left)
}

/// The head has not moved, but against another reference its pose has other numbers: no motion may come of that.
#[test]
fn another_reference_begins_the_track_anew_whether_it_is_told_before_the_pose_or_after() {
    for told_first in [true, false] {
        let mut bench = bench(REPORTED);
        let mut frame = |reference, x| {
            let pose = pose([x, 0.0, 0.1], 1e-4);
            if told_first {
                assert!(report(&mut bench, reference, 0).is_none());
                feed_aged(&mut bench, pose, LATER)
            } else {
                let before = feed_aged(&mut bench, pose, 0);
                report(&mut bench, reference, LATER).or(before)
            }
            .unwrap()
        };
        for _ in 0..50 {
            frame(1, 0.0);
        }
        let track = frame(2, 0.0002);
        assert_eq!((track.run, track.standing()), (1, Standing::Measured), "{told_first}");
        assert_eq!((track.position[0], track.velocity[0]), (0.0002, 0.0), "{told_first}");
        assert_eq!(frame(2, 0.0002).run, 2, "the same reference again changes nothing");
    }
}

#[test]
fn a_steady_motion_is_followed_with_its_velocity() {
    let mut bench = bench(TEXT);
    let mut last = None;
    for step in 0..200 {
        // A measurement each 10 ms: 20 mm/s along x.
        last = feed(&mut bench, pose([0.5 + f64::from(step) * 2e-4, 0.1, 0.2], 1e-4));
    }
    let track = last.unwrap();
    assert!((track.position[0] - 0.5398).abs() < 1e-4, "{:?}", track.position);
    assert!((track.velocity[0] - 0.02).abs() < 2e-3, "{:?}", track.velocity);
    assert_eq!((track.accepted, track.rejected), (200, 0));
    assert!(track.nis >= 0.0 && track.innovation[..3].iter().all(|v| v.is_finite()));
    for i in [0, 1, 2, 6, 7, 8] {
        assert!(track.covariance[13 * i] > 0.0 && track.covariance[13 * i] < 1.0);
    }
    assert_eq!((track.channels, track.standing(), track.run), (0b111, Standing::Measured, 200));
    assert!(track.orientation.iter().all(|v| v.is_nan()) && track.covariance[13 * 3].is_infinite());
}

#[test]
fn the_first_measurement_has_no_innovation() {
    let track = feed(&mut bench(TEXT), pose([1.0, 2.0, 3.0], 1e-3)).unwrap();
    assert_eq!((track.position, track.velocity), ([1.0, 2.0, 3.0], [0.0; 3]));
    assert!(track.nis.is_nan() && track.innovation.iter().all(|v| v.is_nan()));
}

#[test]
fn a_measurement_beyond_the_gate_is_counted_and_only_predicted() {
    let mut bench = bench(TEXT);
    for _ in 0..20 {
        feed(&mut bench, pose([0.5; 3], 1e-4));
    }
    let track = feed(&mut bench, pose([0.9, 0.5, 0.5], 1e-4)).unwrap();
    assert!((track.position[0] - 0.5).abs() < 1e-6);
    assert_eq!((track.accepted, track.rejected, track.standing()), (20, 1, Standing::Refused));
    assert!((track.innovation[0] - 0.4).abs() < 1e-6 && track.nis > 25.0);
    // The next good one is used.
    assert_eq!(feed(&mut bench, pose([0.5; 3], 1e-4)).unwrap().accepted, 21);
}

#[test]
fn a_measurement_without_numbers_is_counted_and_never_stops_it() {
    let mut bench = bench(TEXT);
    feed(&mut bench, pose([0.5; 3], 1e-4));
    for bad in [pose([f64::NAN; 3], 1e-4), pose([0.5; 3], 0.0), pose([0.5; 3], f64::INFINITY)] {
        assert!(feed(&mut bench, bad).unwrap().nis.is_nan());
    }
    let track = feed(&mut bench, pose([0.5; 3], 1e-4)).unwrap();
    assert_eq!((track.accepted, track.rejected), (2, 3));
}

#[test]
fn a_measurement_acquired_before_the_last_one_is_counted_and_sends_nothing() {
    let mut bench = bench(TEXT);
    feed(&mut bench, pose([0.5; 3], 1e-4));
    assert!(feed_aged(&mut bench, pose([0.5; 3], 1e-4), 50_000_000).is_none());
    assert_eq!(feed(&mut bench, pose([0.5; 3], 1e-4)).unwrap().rejected, 1);
}

#[test]
fn a_tick_sends_a_prediction_and_changes_nothing() {
    let text = TEXT.replace("use: estimate.kalman,", "use: estimate.kalman, every: 10 ms,");
    let run = |ticks: bool| {
        let mut bench = bench(&text);
        let mut tracks = Vec::new();
        for step in 0..50_u32 {
            tracks.push(feed(&mut bench, pose([f64::from(step) * 1e-3, 0.0, 0.0], 1e-4)).unwrap().position);
            // Either way 20 ms pass between two measurements.
            let left = if ticks { bench.tick() } else { bench.feed::<Pose>(0, &(), &[], 0) };
            if let (true, Some(track)) = (ticks, track(&left)) {
                assert_eq!(track.standing(), Standing::Predicted);
                assert!(track.nis.is_nan());
                assert!(step < 10 || track.position[0] > tracks[step as usize][0]);
            }
        }
        tracks
    };
    assert_eq!(run(true), run(false));
}

fn with(params: &str) -> Bench {
    bench(&TEXT.replace("gate: 25", &format!("gate: 25, {params}")))
}

#[test]
fn a_track_without_measurements_for_its_horizon_ends_in_a_sample_without_numbers() {
    let text = TEXT.replace("use: estimate.kalman,", "use: estimate.kalman, every: 10 ms,");
    let mut bench = bench(&text.replace("gate: 25", "gate: 25, horizon: 100 ms"));
    // Before the first measurement there is no estimate either.
    assert_eq!(track(&bench.tick()).unwrap().standing(), Standing::None);
    feed(&mut bench, pose([0.5; 3], 1e-3));
    for _ in 0..10 {
        assert_eq!(track(&bench.tick()).unwrap().standing(), Standing::Predicted);
    }
    let ended = track(&bench.tick()).unwrap();
    assert_eq!((ended.standing(), ended.accepted), (Standing::None, 1));
    assert!(ended.position.iter().all(|v| v.is_nan()) && ended.covariance[0].is_infinite());
    // A measurement begins another track, where the head is now.
    let left = bench.feed::<Pose>(0, &(), &[pose([0.9; 3], 1e-3)], 0);
    assert_eq!((track(&left).unwrap().position, track(&left).unwrap().run), ([0.9; 3], 1));
    assert_eq!((metric(&left, "estimate"), metric(&left, "given_up")), (1.0, 1.0));
}

#[test]
fn a_sensor_whose_clock_goes_back_is_late_for_the_horizon_and_then_followed_again() {
    let mut bench = with("horizon: 100 ms");
    feed(&mut bench, pose([0.5; 3], 1e-3));
    let hour = 3_600_000_000_000;
    let mut late = 0;
    let left = loop {
        let left = bench.feed::<Pose>(0, &(), &[pose([0.5, 0.5, 0.5 + f64::from(late) * 1e-4], 1e-3)], hour);
        if track(&left).is_some() {
            break left;
        }
        late += 1;
        assert_eq!(metric(&left, "late"), f64::from(late));
        assert!(late < 20);
    };
    assert_eq!((late, track(&left).unwrap().run), (10, 1));
}

#[test]
fn a_sensor_whose_clock_is_a_little_ahead_is_followed_and_one_that_is_farther_ahead_is_counted_as_early() {
    let text = TEXT.replace("use: estimate.kalman,", "use: estimate.kalman, every: 10 ms,");
    let mut bench = bench(&text);
    for step in 0..20_u32 {
        let (z, ahead) = (0.5 + f64::from(step) * 1e-4, if step % 2 == 0 { -1_000_000 } else { -5_000_000 });
        let sent = feed_aged(&mut bench, pose([0.5, 0.5, z], 1e-3), ahead).unwrap();
        assert_eq!((sent.standing(), sent.accepted), (Standing::Measured, u64::from(step) + 1));
    }
    // One stamp that is far ahead says nothing of now, and spoils nothing.
    for ahead in [-5_000_001, -3_600_000_000_000] {
        let left = bench.feed::<Pose>(0, &(), &[pose([0.9; 3], 1e-3)], ahead);
        assert_eq!(track(&left).unwrap().standing(), Standing::None);
    }
    let predicted = track(&bench.tick()).unwrap();
    assert_eq!((predicted.standing(), predicted.run), (Standing::Predicted, 20));
    let left = bench.feed::<Pose>(0, &(), &[pose([0.5, 0.5, 0.502], 1e-3)], 0);
    let sent = track(&left).unwrap();
    assert_eq!((sent.standing(), sent.run, sent.rejected), (Standing::Measured, 21, 2));
    assert_eq!((metric(&left, "early"), metric(&left, "late"), metric(&left, "given_up")), (2.0, 0.0, 0.0));
}

#[test]
fn how_far_a_clock_may_be_ahead_is_a_parameter() {
    let hour = 3_600_000_000_000;
    let ahead =
        |params: &str, ns: i64| feed_aged(&mut with(params), pose([0.5; 3], 1e-3), -ns).unwrap().standing();
    assert_eq!(ahead("clock_ahead: 50 ms", 50_000_000), Standing::Measured);
    assert_eq!(ahead("clock_ahead: 0 ms", 0), Standing::Measured);
    assert_eq!(ahead("clock_ahead: 0 ms", 1), Standing::None);
    assert_eq!(ahead("clock_ahead: 1 s", hour), Standing::None);
}

#[test]
fn a_frame_that_comes_again_is_counted_as_repeated() {
    let mut bench = bench(TEXT);
    let second = pose([0.5, 0.1, 0.2], 1e-3);
    let repeats: Vec<u64> = (0..4).map(|_| feed(&mut bench, second).unwrap().repeated).collect();
    assert_eq!(repeats, [0, 1, 2, 3]);
    assert_eq!(feed(&mut bench, pose([0.5, 0.1, 0.2 + 1e-9], 1e-3)).unwrap().repeated, 0);
}

#[test]
fn one_coordinate_is_followed_alone() {
    let mut bench = with("follow: z");
    let mut measured = pose([f64::NAN, f64::NAN, 0.4], 1e-3);
    measured.covariance[0] = f64::INFINITY;
    measured.covariance[7] = f64::INFINITY;
    let mut last = feed(&mut bench, measured).unwrap();
    for step in 1..100 {
        measured.position[2] = 0.4 + f64::from(step) * 2e-4;
        last = feed(&mut bench, measured).unwrap();
    }
    assert!((last.position[2] - 0.4198).abs() < 2e-4 && (last.velocity[2] - 0.02).abs() < 5e-3);
    assert!(last.position[0].is_nan() && last.covariance[0].is_infinite());
    assert_eq!((last.channels, last.accepted), (0b100, 100));
}

#[test]
fn a_pose_is_followed_with_its_angular_velocity() {
    let mut bench = with("follow: pose");
    let mut last = None;
    for step in 0..200 {
        // 0.3 rad/s about y, from upside down so that the quaternion's sign comes into it.
        let half = 0.5 * (3.0 + f64::from(step) * 3e-3);
        let mut measured = pose([0.1, 0.2, 0.3], 1e-3);
        measured.orientation = [half.cos(), 0.0, half.sin(), 0.0];
        for i in 3..6 {
            measured.covariance[7 * i] = 1e-6;
        }
        last = feed(&mut bench, measured);
    }
    let track = last.unwrap();
    assert_eq!((track.channels, track.accepted, track.rejected), (0b11_1111, 200, 0));
    assert!((track.angular_velocity[1] - 0.3).abs() < 0.02, "{:?}", track.angular_velocity);
    // The half angle has gone beyond a quarter turn: the sample has the other sign of the quaternion.
    let angle = std::f64::consts::TAU + 2.0 * libm::atan2(track.orientation[2], track.orientation[0]);
    assert!((angle - (3.0 + 199.0 * 3e-3)).abs() < 2e-3 && track.orientation[0] >= 0.0, "{angle}");
}

#[test]
fn a_pose_without_a_rotation_is_refused_where_the_pose_is_followed() {
    let mut bench = with("follow: pose");
    let bad = PoseElement { orientation: [0.0; 4], ..pose([0.1; 3], 1e-3) };
    let track = feed(&mut bench, bad).unwrap();
    assert_eq!((track.standing(), track.accepted, track.rejected), (Standing::None, 0, 1));
}

#[test]
fn the_config_may_say_how_exact_the_measurement_is() {
    let (own, given) = (
        feed(&mut bench(TEXT), pose([0.5; 3], 1e-3)),
        feed(&mut with("measurement_sd: 2 mm"), pose([0.5; 3], 1e-3)),
    );
    assert_eq!((own.unwrap().covariance[0], given.unwrap().covariance[0]), (1e-6, 4e-6));
}

#[test]
fn errors_against_the_truth_have_the_covariance_that_the_filter_claims() {
    let text = TEXT.replace("  filter:", "  truth: { use: feed.pose, frame: couch }\n  filter:").replace(
        "measurement: { from: feed.out, queue: 4 }",
        "measurement: { from: feed.out, queue: 4 }, truth: truth.out",
    );
    let mut bench = bench(&text.replace("gate: 25", "acceleration_sd: 50 mm/s2, gate: 1000"));
    let mut random = Random::new(7);
    let (mut at, mut speed) = ([0.5; 3], [0.0; 3]);
    let (mut nis, mut nees, steps) = (0.0, 0.0, 4000);
    for step in 0..steps + 100 {
        // Measurements every 20 ms, for the truth takes an activation of its own: dt is that between two measurements.
        for i in 0..3 {
            let acceleration = 0.05 * random.normal();
            at[i] += speed[i] * 0.02 + 0.5 * acceleration * 0.02 * 0.02;
            speed[i] += acceleration * 0.02;
        }
        bench.feed::<Pose>(1, &(), &[pose(at, 0.0)], 0);
        let measured = pose(at.map(|x| x + 1e-3 * random.normal()), 1e-3);
        let left = bench.feed::<Pose>(0, &(), &[measured], 10_000_000);
        if step >= 100 {
            nis += metric(&left, "nis");
            nees += metric(&left, "nees");
        }
    }
    // Three channels: the mean of both is 3. NEES is correlated over some 20 steps, so its mean has an sd of about 0.1.
    let (nis, nees) = (nis / f64::from(steps), nees / f64::from(steps));
    assert!((nis - 3.0).abs() < 0.15 && (nees - 3.0).abs() < 0.4, "nis {nis}, nees {nees}");
}

fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -2.0f64..2.0,
        1 => Just(f64::NAN),
        1 => Just(f64::INFINITY),
        1 => Just(f64::MAX),
        1 => Just(-f64::MAX),
        1 => Just(1e-300),
        1 => Just(1e160),
    ]
}

proptest! {
    #[test]
    fn no_measurement_stops_it_and_its_numbers_stay_finite(
        steps in prop::collection::vec(([any_number(), any_number(), any_number()], any_number(), -10_000_000i64..30_000_000), 1..40),
    ) {
        let mut bench = bench(TEXT).padded(3);
        let mut twin = self::bench(TEXT);
        for (position, sd, age) in steps {
            let left = bench.feed::<Pose>(0, &(), &[pose(position, sd)], age);
            prop_assert!(left.fault.is_none(), "{:?}", left.fault);
            prop_assert!(left.bytes() == twin.feed::<Pose>(0, &(), &[pose(position, sd)], age).bytes());
            if let Some(track) = track(&left) {
                let stands = track.standing() != Standing::None;
                prop_assert!(track.position.iter().all(|v| v.is_finite() == stands));
                prop_assert!((0..3).all(|i| track.covariance[13 * i].is_finite() == stands));
            }
        }
        // It works again as soon as measurements are good again, for the variance of a refused one grows.
        prop_assert!(bench.feed::<Pose>(0, &(), &[pose([0.1; 3], 1e-3)], 0).fault.is_none());
    }
}
