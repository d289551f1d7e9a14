//! `estimate.kalman` on a bench.

#![allow(clippy::unwrap_used, clippy::panic)]

use proptest::prelude::*;
use stillpoint_pipeline::files::KeptFiles;
use stillpoint_samples::{Pose, PoseElement, Track, TrackElement};
use stillpoint_testing::Bench;

const TEXT: &str = "
stillpoint: 1
name: estimate
frames: { camera: { parent: couch, at: [0 m, 0 m, 1 m] } }
operators:
  feed: { use: feed.pose, frame: couch }
  filter: { use: estimate.kalman, inputs: { measurement: { from: feed.out, queue: 4 } }, params: { gate: 25 } }
";

fn bench(text: &str) -> Bench {
    Bench::new(text, "filter", stillpoint_estimate::STAGES, &KeptFiles::default()).unwrap()
}

fn pose(position: [f64; 3], sd: f64) -> PoseElement {
    let mut covariance = [0.0; 36];
    for i in 0..3 {
        covariance[7 * i] = sd * sd;
        covariance[7 * (i + 3)] = f64::INFINITY;
    }
    PoseElement { position, orientation: [1.0, 0.0, 0.0, 0.0], covariance }
}

fn feed_aged(bench: &mut Bench, pose: PoseElement, age: u64) -> Option<TrackElement> {
    let left = bench.feed::<Pose>(0, &(), &[pose], age);
    assert_eq!(left.fault, None);
    left.outputs.first().map(|(_, p)| *p.pieces().view::<Track>().unwrap().first().unwrap())
}

fn feed(bench: &mut Bench, pose: PoseElement) -> Option<TrackElement> {
    feed_aged(bench, pose, 0)
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
    assert!(track.nis >= 0.0 && track.innovation.iter().all(|v| v.is_finite()));
    for i in 0..6 {
        assert!(track.covariance[7 * i] > 0.0);
    }
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
    assert_eq!((track.accepted, track.rejected), (20, 1));
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
            if let (true, Some((_, p))) = (ticks, left.outputs.first()) {
                let track = *p.pieces().view::<Track>().unwrap().first().unwrap();
                assert!(track.nis.is_nan());
                assert!(step < 10 || track.position[0] > tracks[step as usize][0]);
            }
        }
        tracks
    };
    assert_eq!(run(true), run(false));
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
        steps in prop::collection::vec(([any_number(), any_number(), any_number()], any_number(), 0u64..30_000_000), 1..40),
    ) {
        let mut bench = bench(TEXT).padded(3);
        let mut twin = self::bench(TEXT);
        for (position, sd, age) in steps {
            let left = bench.feed::<Pose>(0, &(), &[pose(position, sd)], age);
            prop_assert!(left.fault.is_none(), "{:?}", left.fault);
            prop_assert!(left.bytes() == twin.feed::<Pose>(0, &(), &[pose(position, sd)], age).bytes());
            if let Some((_, parcel)) = left.outputs.first() {
                let track = *parcel.pieces().view::<Track>().unwrap().first().unwrap();
                prop_assert!(track.position.iter().chain(&track.covariance).all(|v| v.is_finite()));
            }
        }
        // It works again as soon as measurements are good again, for the variance of a refused one grows.
        prop_assert!(bench.feed::<Pose>(0, &(), &[pose([0.1; 3], 1e-3)], 0).fault.is_none());
    }
}
