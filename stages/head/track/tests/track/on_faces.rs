//! `track.head` on a bench, with the parts of the face found: a fist, a hand and a mask on it.
//!
//! Chin, mouth and cheeks have little weight there, and a face may move by itself. What is not of the face is neither.

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use stillpoint_mechanics::random::Random;
use stillpoint_rig::head::Head;
use stillpoint_rig::ray::{self, Ray};
use stillpoint_rig::shape::Ellipsoid;
use stillpoint_samples::{PoseReportElement, PoseStatus, Proof, Unproven};
use stillpoint_testing::Bench;
use stillpoint_track::tracker::HeadTracker;

use crate::head::{Said, feed, isometry, lying, moved};
use crate::identity::{masked, with_fist};
use crate::shapes::{camera_from_body, head, seen};

const MS: u64 = 1_000_000;
/// Noise of the points along their rays, m.
const NOISES: [f64; 2] = [0.2e-3, 0.5e-3];
/// Middle of the fist on the chin, and of the hand on a temple, m.
const FIST: [f64; 3] = [0.0, -0.075, 0.085];
const HAND: [f64; 3] = [0.055, 0.045, 0.075];

fn couch_from_camera() -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::x_axis(), core::f64::consts::PI)
}

/// The rig's head with a hand on its temple, which was shifted by so much.
fn with_hand(camera_from_head: &Isometry3<f64>, shift: Vector3<f64>) -> Vec<Vector3<f64>> {
    let head = Head::new(1.0).unwrap();
    let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 0.6);
    let place = Isometry3::from_parts((Vector3::from(HAND) + shift).into(), turn);
    let hand = Ellipsoid::new(place, Vector3::new(0.045, 0.06, 0.016)).unwrap();
    seen(camera_from_head, |origin, direction| {
        let ray = Ray { origin: *origin, direction: *direction };
        let hits = head.parts().iter().chain([&hand]).filter_map(|part| ray::ellipsoid(&ray, part));
        hits.map(|hit| hit.t).min_by(f64::total_cmp)
    })
}

/// A thing on a head: its points where the head is and the thing was shifted by so much, and its middle.
type Thing = (fn(&Isometry3<f64>, Vector3<f64>) -> Vec<Vector3<f64>>, [f64; 3]);
const THINGS: [Thing; 2] = [(with_fist, FIST), (with_hand, HAND)];

fn noisy(cloud: Vec<Vector3<f64>>, noise: f64, random: &mut Random) -> Vec<Vector3<f64>> {
    cloud.into_iter().map(|p| p * (1.0 + noise * random.normal() / p.norm())).collect()
}

/// The head in a frame of 0.1 s of a breath.
fn breathing(frame: u32) -> Isometry3<f64> {
    let phase = std::f64::consts::TAU * 0.25 * 0.1 * f64::from(frame);
    moved([0.0, 0.0, 0.3e-3 * phase.sin()], [1.7e-3 * phase.sin(), 0.0, 0.0])
}

fn frame(bench: &mut Bench, number: u32, cloud: &[Vector3<f64>]) -> Said {
    bench.at(u64::from(number) * 100 * MS);
    feed(bench, cloud)
}

/// The head breathes for 6 s while the camera sees it so, with this noise. Returns the report then.
fn breathe(noise: f64, seen: impl Fn(&Isometry3<f64>) -> Vec<Vector3<f64>>) -> PoseReportElement {
    let (mut bench, mut random) = (lying(str::to_owned), Random::stream(3, 0));
    let mut element = None;
    for number in 0..60 {
        let cloud = noisy(seen(&breathing(number)), noise, &mut random);
        element = Some(frame(&mut bench, number, &cloud));
    }
    let report = element.unwrap().report;
    assert_eq!(report.face, 1);
    report
}

/// The proof, and why there is none.
fn state(report: &PoseReportElement) -> (u32, u32) {
    (report.proof, report.unproven)
}

#[test]
fn the_parts_of_a_face_are_found_with_a_fist_a_hand_and_a_mask_on_it() {
    let at = camera_from_body();
    let [fist, hand] = THINGS.map(|(cloud, _)| cloud(&at, Vector3::zeros()));
    for cloud in [head(&at), fist, hand, masked(&at, &Isometry3::identity(), true)] {
        let mut tracker = HeadTracker::default();
        tracker.lies_on(couch_from_camera());
        assert!(tracker.surface_of(&cloud).unwrap().has_face());
        // The bench of the other tests turns the head by more than one on a couch is.
        tracker.lies_on(UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::FRAC_PI_2));
        assert!(!tracker.surface_of(&cloud).unwrap().has_face());
    }
}

#[test]
fn a_breath_proves_a_face_with_what_moves_with_it_and_none_with_what_is_at_rest_on_it() {
    for noise in NOISES {
        for (cloud, middle) in THINGS {
            let middle = Point3::from(middle);
            let at_rest = |head: &Isometry3<f64>| head.inverse() * (camera_from_body() * middle) - middle;
            let with = breathe(noise, |head| cloud(head, Vector3::zeros()));
            let rests = breathe(noise, |head| cloud(head, at_rest(head)));
            assert_eq!(state(&with), (Proof::Proven as u32, Unproven::None as u32), "{middle} {noise}");
            assert_eq!(
                state(&rests),
                (Proof::Waiting as u32, Unproven::PieceApart as u32),
                "{middle} {noise}"
            );
        }
    }
}

#[test]
fn a_breath_proves_a_face_in_a_mask_that_moves_with_it_and_none_in_one_at_rest() {
    let at_rest = |head: &Isometry3<f64>| camera_from_body().inverse() * head;
    for noise in NOISES {
        let with = breathe(noise, |head| masked(head, &Isometry3::identity(), true));
        let rests = breathe(noise, |head| masked(head, &at_rest(head), true));
        assert_eq!(state(&with), (Proof::Proven as u32, Unproven::None as u32), "{noise}");
        assert_eq!(state(&rests), (Proof::Waiting as u32, Unproven::Mixed as u32), "{noise}");
    }
}

#[test]
fn a_mask_that_stays_where_the_face_was_is_not_the_head() {
    let (mut bench, mut random) = (lying(str::to_owned), Random::stream(3, 0));
    let mut at = |number: u32, is_there: bool| {
        let cloud =
            noisy(masked(&breathing(number), &Isometry3::identity(), is_there), NOISES[0], &mut random);
        frame(&mut bench, number, &cloud)
    };
    let there = (0..35).map(|number| at(number, true)).last().unwrap();
    assert_eq!((there.status(), there.report.proof), (PoseStatus::Tracked, Proof::Proven as u32));
    let gone = at(35, false);
    assert_eq!((gone.status(), gone.pose), (PoseStatus::Doubted, None), "{:?}", gone.report);
}

/// What a thing that was proven with the head does to the pose when it moves apart.
struct Apart {
    /// Largest errors of poses that may have a beam: shift of the middle of the skull, m, and turn, rad.
    shift: f64,
    turn: f64,
    /// How many frames after it began to move apart the last pose with a beam was.
    last: u32,
}

/// The head and a thing on it breathe together for 2 s. Then the head goes on as `head` says, by its steps since, and the
/// thing is shifted as `shift` says, in the head's axes.
fn apart(
    noise: f64,
    cloud: fn(&Isometry3<f64>, Vector3<f64>) -> Vec<Vector3<f64>>,
    now: impl Fn(u32, Isometry3<f64>) -> (Isometry3<f64>, Vector3<f64>),
) -> Apart {
    let (mut bench, mut random) = (lying(str::to_owned), Random::stream(3, 0));
    let middle = Point3::new(0.0, 0.03, 0.0);
    let couch = Isometry3::from_parts(Vector3::new(1.0, 2.0, 3.0).into(), couch_from_camera());
    let mut first = None;
    let mut found = Apart { shift: 0.0, turn: 0.0, last: 0 };
    for number in 0..60_u32 {
        let steps = number.saturating_sub(19);
        let (head, shift) = match steps {
            0 => (breathing(number), Vector3::zeros()),
            _ => now(steps, breathing(number)),
        };
        let element = frame(&mut bench, number, &noisy(cloud(&head, shift), noise, &mut random));
        if number == 19 {
            assert_eq!(element.report.proof, Proof::Proven as u32);
        }
        let has_beam = [PoseStatus::Captured, PoseStatus::Tracked, PoseStatus::Found];
        let Some(pose) = element.pose.filter(|_| has_beam.contains(&element.status())) else { continue };
        let first = *first.get_or_insert(isometry(&pose));
        let moved = isometry(&pose) * first.inverse();
        let exact = couch * head * camera_from_body().inverse() * couch.inverse();
        let at = couch * (camera_from_body() * middle);
        found.shift = found.shift.max((moved * at - exact * at).norm());
        found.turn = found.turn.max((moved.rotation * exact.rotation.inverse()).angle());
        found.last = steps;
    }
    found
}

#[test]
fn what_moves_apart_from_a_face_ends_the_beam_before_it_draws_the_pose_away() {
    let noise = NOISES[0];
    for (cloud, middle) in THINGS {
        // The thing slides away, slowly or not; or it stays while the head nods.
        let slides = |by: f64| {
            move |steps: u32, head: Isometry3<f64>| {
                (head, Vector3::new(0.0, 0.45, 0.89) * (by * f64::from(steps)))
            }
        };
        let nods = |steps: u32, head: Isometry3<f64>| {
            let nod = Vector3::x() * (0.1 * f64::from(steps)).to_radians();
            let turned = UnitQuaternion::from_scaled_axis(nod) * head.rotation;
            let turned = Isometry3::from_parts(head.translation, turned);
            let middle = Point3::from(middle);
            (turned, turned.inverse() * (head * middle) - middle)
        };
        let all = [
            apart(noise, cloud, slides(0.1e-3)),
            apart(noise, cloud, slides(1e-3)),
            apart(noise, cloud, nods),
        ];
        for (number, found) in all.iter().enumerate() {
            let (shift, turn) = (1e3 * found.shift, found.turn.to_degrees());
            eprintln!("{middle:?} case {number}: {shift:.2} mm, {turn:.2} degrees, {} steps", found.last);
            // A large hand draws the pose by more than a fist, since all of it counts as rigid.
            assert!(shift < 0.8 && turn < 0.8, "{middle:?} {number}: {shift} mm {turn} degrees");
            assert!(found.last < 30, "{middle:?} {number}: {} steps", found.last);
        }
    }
}
