//! `plan.watch` and `plan.optimizer` in a pipeline, in the simulated executor.

#![allow(clippy::unwrap_used)]

mod small;

use small::{files, hash, stages};
use stillpoint_operator::Registry;
use stillpoint_samples::{PlanRequest, PlanStanding, PlanUpdate, Pose, PoseElement};
use stillpoint_testing::{Bench, run};

const TEXT: &str = "
stillpoint: 1
name: watched
frames: { camera: { parent: couch, at: [0 m, 0 m, 1 m] } }
operators:
  patient: { use: test.poses, every: 100 ms, frame: couch }
  watch:
    use: plan.watch
    inputs: { pose: patient.out }
    params: { case: small.case, beams: 5, budget: 6, distance: 3 mm, dwell: 500 ms, isocentre: [100 mm, 200 mm, 300 mm] }
  plans:
    use: plan.optimizer
    every: 200 ms
    inputs: { request: watch.request }
    params: { case: small.case, angles: 10, grid: 8 mm, bixel: 14 mm }
";

#[test]
fn a_patient_who_moves_and_stays_there_gets_a_request_and_an_answer_the_same_in_each_run() {
    let registry = Registry::new(&[&stages()]);
    let play = || run(TEXT, &registry, &files(), 4500).unwrap();
    let first = play();
    assert!(first.failed().is_empty());
    let requests = first.samples::<PlanRequest>("watch.request");
    let shifts: Vec<[f64; 3]> = requests.iter().map(|r| r.elements[0].position).collect();
    assert_eq!(shifts.len(), 2, "{shifts:?}");
    assert_eq!(shifts[0], [0.0; 3]);
    assert!((shifts[1][0] - 0.009).abs() < 1e-9 && shifts[1][1].abs() < 1e-9, "{shifts:?}");
    assert!(requests.iter().all(|r| r.elements[0].case_hash == hash()));
    let updates = first.samples::<PlanUpdate>("plans.plan");
    let ends: Vec<_> =
        updates.iter().filter(|u| u.body.ended == 1).map(|u| (u.body.request, u.body.standing())).collect();
    assert_eq!(ends, [(0, PlanStanding::Holds), (1, PlanStanding::Fails)]);
    assert_eq!(first.bytes("plans.plan"), play().bytes("plans.plan"));
}

fn watch(params: &str) -> Bench {
    let text = format!(
        "
stillpoint: 1
name: watch
frames: {{ camera: {{ parent: couch, at: [0 m, 0 m, 1 m] }} }}
operators:
  poses: {{ use: feed.pose, frame: couch }}
  watch: {{ use: plan.watch, inputs: {{ pose: poses.out }}, params: {{ case: small.case, dwell: 100 ms{params} }} }}
"
    );
    Bench::new(&text, "watch", &stages(), &files()).unwrap()
}

fn see(
    bench: &mut Bench,
    ms: u64,
    position: [f64; 3],
    orientation: [f64; 4],
) -> Option<([f64; 3], [f64; 4])> {
    let pose = PoseElement { position, orientation, covariance: [0.0; 36] };
    let left = bench.at(ms * 1_000_000).feed::<Pose>(0, &(), &[pose], 0);
    assert_eq!(left.fault, None);
    let (_, request) = left.outputs.first()?;
    let request = request.pieces().view::<PlanRequest>().unwrap().elements[0];
    Some((request.position, request.orientation))
}

const UPRIGHT: [f64; 4] = [1.0, 0.0, 0.0, 0.0];

#[test]
fn a_set_up_error_is_counted_at_the_isocentre_from_the_first_pose_or_from_the_plan() {
    let isocentre = ", isocentre: [0 mm, 100 mm, 0 mm], distance: 3 mm, turn: 5 deg";
    let mut from_first = watch(isocentre);
    assert_eq!(see(&mut from_first, 0, [0.02, 0.0, 0.0], UPRIGHT), Some(([0.0; 3], UPRIGHT)));
    // A turn of 0.05 rad about z takes the isocentre, 100 mm away along y, 5 mm along -x.
    let turned = [0.025_f64.cos(), 0.0, 0.0, 0.025_f64.sin()];
    let origin = [0.02 * 0.05_f64.cos(), 0.02 * 0.05_f64.sin(), 0.0];
    assert_eq!(see(&mut from_first, 50, origin, turned), None);
    assert_eq!(see(&mut from_first, 149, origin, turned), None);
    let (position, orientation) = see(&mut from_first, 150, origin, turned).unwrap();
    assert!((position[0] + 0.1 * 0.05_f64.sin()).abs() < 1e-9, "{position:?}");
    assert!(orientation.iter().zip(turned).all(|(a, b)| (a - b).abs() < 1e-9), "{orientation:?}");
    assert_eq!(see(&mut from_first, 900, origin, turned), None, "it is the requested set-up now");

    let mut from_plan = watch(&format!("{isocentre}, planned: isocentre"));
    let shifted = [0.0, 0.104, 0.0];
    assert_eq!(
        see(&mut from_plan, 0, shifted, UPRIGHT),
        Some(([0.0; 3], UPRIGHT)),
        "the planned set-up first"
    );
    assert_eq!(see(&mut from_plan, 10, shifted, UPRIGHT), None);
    let (position, _) = see(&mut from_plan, 110, shifted, UPRIGHT).unwrap();
    assert!((position[1] - 0.004).abs() < 1e-9, "{position:?}");
}

#[test]
fn a_short_motion_and_poses_without_numbers_have_no_effect() {
    let mut bench = watch("");
    assert_eq!(see(&mut bench, 0, [f64::NAN, 0.0, 0.0], UPRIGHT), None);
    assert_eq!(see(&mut bench, 5, [0.0; 3], [0.0; 4]), None);
    assert!(see(&mut bench, 10, [0.0; 3], UPRIGHT).is_some());
    assert_eq!(see(&mut bench, 20, [0.01, 0.0, 0.0], UPRIGHT), None);
    assert_eq!(see(&mut bench, 100, [0.0; 3], UPRIGHT), None);
    assert_eq!(see(&mut bench, 130, [0.01, 0.0, 0.0], UPRIGHT), None, "the patient was back in between");
    assert_eq!(see(&mut bench, 140, [0.01, f64::INFINITY, 0.0], UPRIGHT), None);
    // A turn alone counts, too.
    let turned = [0.02_f64.cos(), 0.02_f64.sin(), 0.0, 0.0];
    assert_eq!(see(&mut bench, 150, [0.0; 3], UPRIGHT), None);
    assert_eq!(see(&mut bench, 160, [0.0; 3], turned), None);
    assert!(see(&mut bench, 260, [0.0; 3], turned).is_some());
}

#[test]
fn poses_of_another_frame_are_refused() {
    let text = "
stillpoint: 1
name: watch
frames: { camera: { parent: couch, at: [0 m, 0 m, 1 m] } }
operators:
  poses: { use: feed.pose, frame: camera }
  watch: { use: plan.watch, inputs: { pose: poses.out }, params: { case: small.case } }
";
    let fault = Bench::new(text, "watch", &stages(), &files()).err().unwrap();
    assert!(fault.contains("`camera`") && fault.contains("`couch`"), "{fault}");
}
