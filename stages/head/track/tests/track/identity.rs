//! `track.head` on a bench: whether what is followed is what was captured, whether its parts were seen to move together,
//! and who confirmed it. The benches take all of the head for rigid; `on_faces` tests heads whose faces were found.

use nalgebra::{Isometry3, Point3, Vector3};
use stillpoint_rig::head::Head;
use stillpoint_rig::ray::{self, Ray};
use stillpoint_rig::shape::Ellipsoid;
use stillpoint_samples::{
    Health, IdentityPart, PieceState, PoseReportElement, PoseStatus, Proof, SensorHealth, SurfacePiece,
    Unproven, Verb,
};
use stillpoint_testing::Bench;

use crate::head::{bench, command, confirm, feed, moved};
use crate::shapes::{camera_from_body, head, seen, sphere};

const MS: u64 = 1_000_000;

/// The rig's head with a fist on its chin, which was shifted by so much.
pub fn with_fist(camera_from_head: &Isometry3<f64>, shift: Vector3<f64>) -> Vec<Vector3<f64>> {
    let head = Head::new(1.0).unwrap();
    let fist = Point3::new(0.0, -0.075, 0.085) + shift;
    seen(camera_from_head, |origin, direction| {
        let ray = Ray { origin: *origin, direction: *direction };
        let hits = head.parts().iter().filter_map(|part| ray::ellipsoid(&ray, part)).map(|hit| hit.t);
        let (a, offset) = (direction.norm_squared(), origin - fist);
        let b = offset.dot(direction);
        let root = b * b - a * (offset.norm_squared() - 0.05 * 0.05);
        hits.chain((root > 0.0).then(|| (-b - root.sqrt()) / a)).min_by(f64::total_cmp)
    })
}

/// A perforated mask 2 mm over the rig's head at rest, with the head in it or without.
pub fn masked(
    camera_from_head: &Isometry3<f64>,
    mask_from_head: &Isometry3<f64>,
    is_there: bool,
) -> Vec<Vector3<f64>> {
    let head = Head::new(1.0).unwrap();
    let mask: Vec<Ellipsoid> = head
        .parts()
        .iter()
        .map(|part| Ellipsoid::new(*part.parent_from_shape(), part.semi_axes().add_scalar(0.002)).unwrap())
        .collect();
    // Holes of 6.4 mm every 10 mm.
    let is_solid = |place: &Point3<f64>| {
        let cell = |along: f64| along - (along / 0.01).round() * 0.01;
        cell(place.x).hypot(cell(place.y)) > 0.0032
    };
    seen(camera_from_head, |origin, direction| {
        let ray = Ray { origin: *origin, direction: *direction };
        let first = |parts: &[Ellipsoid], ray: &Ray| {
            parts.iter().filter_map(|part| ray::ellipsoid(ray, part)).map(|hit| hit.t).min_by(f64::total_cmp)
        };
        let at_mask = Ray { origin: mask_from_head * origin, direction: mask_from_head * direction };
        let solid = first(&mask, &at_mask).filter(|t| is_solid(&(at_mask.origin + at_mask.direction * *t)));
        let face = first(head.parts(), &ray).filter(|_| is_there);
        [solid, face].into_iter().flatten().min_by(f64::total_cmp)
    })
}

fn part(report: &PoseReportElement, part: IdentityPart) -> f64 {
    report.certainty[part as usize]
}

#[test]
fn the_head_that_was_captured_is_certain_while_it_moves() {
    let mut bench = bench(str::to_owned);
    feed(&mut bench, &head(&camera_from_body()));
    for k in 1..6 {
        let k = f64::from(k);
        let element =
            feed(&mut bench, &head(&moved([1e-3 * k, -2e-3 * k, 2e-3 * k], [0.02 * k, -0.01 * k, 0.03 * k])));
        assert_eq!(element.status(), PoseStatus::Tracked);
        assert!(element.report.confidence > 0.6, "{:?}", element.report.certainty);
        assert!(
            (element.report.scale - 1.0).abs() < 0.01 && element.report.apart < 0.3e-3,
            "{:?}",
            element.report
        );
    }
}

#[test]
fn a_fist_on_the_chin_that_moves_apart_ends_the_poses() {
    let mut bench = bench(str::to_owned);
    feed(&mut bench, &with_fist(&camera_from_body(), Vector3::zeros()));
    let together = feed(&mut bench, &with_fist(&moved([0.0, 0.0, 2e-3], [0.0; 3]), Vector3::zeros()));
    assert_eq!(together.status(), PoseStatus::Tracked, "{:?}", together.report);
    // The head turns and goes on, and the fist stays behind.
    let mut apart = None;
    for k in 1..=8 {
        let mm = 1e-3 * f64::from(k);
        let element =
            feed(&mut bench, &with_fist(&moved([0.0, 0.0, 2e-3], [0.0; 3]), Vector3::new(0.0, mm, 2.0 * mm)));
        if element.status() != PoseStatus::Tracked {
            assert_eq!(
                (element.status(), element.pose.is_none()),
                (PoseStatus::Doubted, true),
                "{:?}",
                element.report
            );
            assert!(part(&element.report, IdentityPart::Agreement) < 0.5);
            apart = Some(k);
            break;
        }
    }
    assert!(apart.is_some_and(|mm| mm <= 5), "{apart:?}");
}

/// The head nods by this many degrees in steps of 0.1 while a fist lies on its chin, at rest or as a part of the head.
/// Returns the angle at which the poses ended.
fn nod_under_a_fist(degrees: f64, is_at_rest: bool) -> Option<f64> {
    let mut bench = bench(str::to_owned);
    let fist = Point3::new(0.0, -0.075, 0.085);
    for _ in 0..6 {
        feed(&mut bench, &with_fist(&camera_from_body(), Vector3::zeros()));
    }
    for step in 1..=(10.0 * degrees).round() as u32 {
        let angle = 0.1 * f64::from(step);
        let camera_from_head = moved([0.0; 3], [angle.to_radians(), 0.0, 0.0]);
        let shift = match is_at_rest {
            true => camera_from_head.inverse() * (camera_from_body() * fist) - fist,
            false => Vector3::zeros(),
        };
        let element = feed(&mut bench, &with_fist(&camera_from_head, shift));
        if element.status() == PoseStatus::Doubted {
            assert!(part(&element.report, IdentityPart::Agreement) < 0.5, "{:?}", element.report);
            return Some(angle);
        }
    }
    None
}

#[test]
fn a_fist_that_stays_while_the_head_nods_is_found_within_a_degree() {
    let found = nod_under_a_fist(1.5, true);
    assert!(found.is_some_and(|angle| angle <= 1.0), "{found:?}");
    assert_eq!(nod_under_a_fist(3.0, false), None);
}

/// Distance of the middle of a piece from a place, m.
fn distance(piece: &SurfacePiece, place: &Point3<f64>) -> f64 {
    (Point3::from(piece.xyz.map(f64::from)) - place).norm()
}

#[test]
fn the_pieces_of_a_head_lie_on_it_where_it_is_and_none_moves_by_itself() {
    let mut bench = bench(str::to_owned);
    feed(&mut bench, &head(&camera_from_body()));
    for k in 1..8 {
        let k = f64::from(k);
        let cloud = head(&moved([0.0, 0.0, 1e-3 * k], [0.01 * k, 0.0, 0.005 * k]));
        let pieces = feed(&mut bench, &cloud).pieces;
        let seen = pieces.iter().filter(|piece| piece.state != PieceState::Unseen as u32);
        assert!(pieces.len() > 30 && 2 * seen.count() > pieces.len());
        assert!(pieces.iter().all(|piece| piece.over < 1.0 && piece.state != PieceState::Against as u32));
        for piece in pieces {
            let nearest =
                cloud.iter().map(|p| distance(&piece, &Point3::from(*p))).fold(f64::INFINITY, f64::min);
            // The mean of a cell of a curved surface lies a little inside.
            assert!(nearest < 8e-3, "{piece:?} is {nearest} m from the head");
        }
    }
}

#[test]
fn the_pieces_that_move_by_themselves_are_those_of_the_fist() {
    let mut bench = bench(str::to_owned);
    let fist = Point3::new(0.0, -0.075, 0.085);
    for _ in 0..6 {
        feed(&mut bench, &with_fist(&camera_from_body(), Vector3::zeros()));
    }
    let at_rest = camera_from_body() * fist;
    let nod = |step: u32| {
        let camera_from_head = moved([0.0; 3], [(0.1 * f64::from(step)).to_radians(), 0.0, 0.0]);
        let shift = camera_from_head.inverse() * at_rest - fist;
        feed(&mut bench, &with_fist(&camera_from_head, shift))
    };
    let mut frames = (1..=10).map(nod);
    let pieces = frames.find(|frame| frame.status() == PoseStatus::Doubted).unwrap().pieces;
    let (apart, others): (Vec<_>, Vec<_>) = pieces.iter().partition(|piece| piece.over > 1.0);
    // A piece of 35 mm that reaches over the fist holds some of it.
    assert!(
        !apart.is_empty() && apart.iter().all(|piece| distance(piece, &at_rest) < 0.05 + 0.04),
        "{apart:?}"
    );
    let far = others.iter().filter(|piece| distance(piece, &at_rest) > 0.1).count();
    assert!(far > 20 && apart.iter().any(|piece| distance(piece, &at_rest) < 0.06), "{far}");
}

#[test]
fn a_mask_that_stays_where_the_head_was_is_not_the_head() {
    let mut bench = bench(str::to_owned);
    for _ in 0..6 {
        feed(&mut bench, &masked(&camera_from_body(), &Isometry3::identity(), true));
    }
    let there = feed(&mut bench, &masked(&moved([0.0, 0.0, 2e-3], [0.0; 3]), &Isometry3::identity(), true));
    assert_eq!(there.status(), PoseStatus::Tracked, "{:?}", there.report);
    assert!(part(&there.report, IdentityPart::Overlap) > 0.9, "{:?}", there.report.certainty);
    let gone = feed(&mut bench, &masked(&camera_from_body(), &Isometry3::identity(), false));
    assert_eq!((gone.status(), gone.pose), (PoseStatus::Doubted, None), "{:?}", gone.report);
    assert!(part(&gone.report, IdentityPart::Overlap) < 0.5, "{:?}", gone.report.certainty);
}

/// Notes the cameras of the next frames.
fn cameras(bench: &mut Bench, reasons: [&str; 2]) {
    let camera = |reason| SensorHealth {
        age: 0.0,
        since: 0.0,
        distance: f64::NAN,
        used: 0,
        left_out: 0,
        name: [0; 16],
        reason: SensorHealth::field(reason),
    };
    bench.feed::<Health>(5, &(), &reasons.map(camera), 0);
}

/// How many points other cameras see of a head is measured without a proof, so the head may have gone with the cameras.
#[test]
fn what_other_cameras_see_is_not_proven_and_long_after_is_not_even_a_pose() {
    for (gap_ms, is_soon) in [(100, true), (5000, false)] {
        let mut bench = bench(str::to_owned);
        cameras(&mut bench, ["used", "used"]);
        let mut time = 0;
        let mut at = |bench: &mut Bench, ms: u64, height: f64| {
            time += ms;
            bench.at(time * MS);
            feed(bench, &head(&moved([0.0, 0.0, height], [0.0; 3])))
        };
        let heights = [0.0, 1e-5, -1e-5, 2e-5, -2e-5, 0.21e-3, 0.22e-3, 0.23e-3];
        let there = heights.map(|height| at(&mut bench, 100, height));
        assert_eq!(there[7].report.proof, Proof::Proven as u32, "{:?}", there[7].report);
        cameras(&mut bench, ["used", "late"]);
        for frame in 0..8 {
            // A cloud that repeats itself is that of a frozen camera.
            let height = 0.2e-3 + 1e-6 * f64::from(frame);
            let other = at(&mut bench, if frame == 0 { gap_ms } else { 50 }, height);
            assert_ne!(other.report.proof, Proof::Proven as u32, "{frame}: {:?}", other.report);
            assert_eq!(other.pose.is_some(), is_soon, "{frame}: {:?}", other.report);
        }
        cameras(&mut bench, ["used", "used"]);
        let back = at(&mut bench, 100, 0.2e-3);
        assert_eq!((back.report.proof, back.status()), (Proof::Proven as u32, PoseStatus::Tracked));
    }
}

#[test]
fn a_thing_of_another_size_is_not_what_was_captured() {
    let mut bench = bench(|t| t.replace("capture: first", "capture: first, directions: any"));
    feed(&mut bench, &sphere(&camera_from_body(), 0.09));
    let larger = feed(&mut bench, &sphere(&camera_from_body(), 0.097));
    assert!(larger.report.scale > 1.05, "{:?}", larger.report);
    assert_eq!((larger.status(), larger.pose), (PoseStatus::Doubted, None));
}

#[test]
fn a_head_far_from_where_it_was_captured_is_doubted() {
    let mut bench = bench(str::to_owned);
    feed(&mut bench, &head(&camera_from_body()));
    // It goes away by and by, so that it is followed.
    let mut status = PoseStatus::Tracked;
    for k in 1..=18 {
        status = feed(&mut bench, &head(&moved([0.0, 0.0, 0.01 * f64::from(k)], [0.0; 3]))).status();
        assert_eq!(status == PoseStatus::Doubted, k >= 15, "{k}: {status:?}");
    }
    assert_eq!(status, PoseStatus::Doubted);
}

fn proof(report: &PoseReportElement) -> u32 {
    report.proof
}

#[test]
fn a_reference_is_proven_by_a_movement_of_all_its_parts_and_fails_without() {
    let mut moving = bench(str::to_owned);
    assert_eq!(proof(&feed(&mut moving, &head(&camera_from_body())).report), Proof::Waiting as u32);
    let noise = [1e-5, -1e-5, 2e-5, -2e-5].map(|z| feed(&mut moving, &head(&moved([0.0, 0.0, z], [0.0; 3]))));
    let noise = &noise[3];
    assert_eq!(proof(&noise.report), Proof::Waiting as u32, "{}", noise.report.moved);
    // One frame that errs by this is none; a movement that lasts is one.
    let once = feed(&mut moving, &head(&moved([0.0, 0.0, 0.12e-3], [0.0; 3])));
    assert_eq!(proof(&once.report), Proof::Waiting as u32, "{}", once.report.moved);
    let lasting =
        [0.21e-3, 0.22e-3, 0.23e-3].map(|z| feed(&mut moving, &head(&moved([0.0, 0.0, z], [0.0; 3]))));
    assert_eq!(proof(&lasting[2].report), Proof::Proven as u32, "{}", lasting[2].report.moved);
    // Another reference is another proof.
    command(&mut moving, Verb::Capture);
    assert_eq!(proof(&feed(&mut moving, &head(&camera_from_body())).report), Proof::Waiting as u32);

    let mut still = bench(str::to_owned);
    feed(&mut still, &head(&camera_from_body()));
    let at = |bench: &mut Bench, ms: u64| {
        bench.at(ms * MS);
        proof(&feed(bench, &head(&moved([0.0, 0.0, 1e-5], [0.0; 3]))).report)
    };
    assert_eq!(at(&mut still, 9_900), Proof::Waiting as u32);
    assert_eq!(at(&mut still, 10_200), Proof::Failed as u32);
    let failed = feed(&mut still, &head(&camera_from_body())).report;
    assert_eq!((failed.unproven, failed.face), (Unproven::TooLittleMotion as u32, 0));
    // A movement after the limit proves nothing any more.
    still.at(10_300 * MS);
    let late = feed(&mut still, &head(&moved([0.0, 0.0, 3e-3], [0.0; 3])));
    assert_eq!(proof(&late.report), Proof::Failed as u32);
}

/// The head breathes for 6 s while the camera sees it so. Returns the proof then.
fn breathe(seen: impl Fn(&Isometry3<f64>) -> Vec<Vector3<f64>>) -> u32 {
    let mut bench = bench(str::to_owned);
    let mut last = None;
    for frame in 0..60_u64 {
        bench.at(frame * 100 * MS);
        let phase = std::f64::consts::TAU * 0.25 * 0.1 * frame as f64;
        let camera_from_head = moved([0.0, 0.0, 0.3e-3 * phase.sin()], [1.7e-3 * phase.sin(), 0.0, 0.0]);
        last = Some(proof(&feed(&mut bench, &seen(&camera_from_head)).report));
    }
    last.unwrap()
}

#[test]
fn a_breath_proves_a_head_and_none_with_a_fist_at_rest_on_it() {
    let fist = Point3::new(0.0, -0.075, 0.085);
    let at_rest = |head: &Isometry3<f64>| head.inverse() * (camera_from_body() * fist) - fist;
    assert_eq!(breathe(|head| with_fist(head, Vector3::zeros())), Proof::Proven as u32);
    assert_eq!(breathe(|head| with_fist(head, at_rest(head))), Proof::Waiting as u32);
}

#[test]
fn a_breath_proves_a_head_in_a_mask_that_moves_with_it_and_none_in_one_at_rest() {
    let at_rest = |head: &Isometry3<f64>| camera_from_body().inverse() * head;
    assert_eq!(breathe(|head| masked(head, &Isometry3::identity(), true)), Proof::Proven as u32);
    assert_eq!(breathe(|head| masked(head, &at_rest(head), true)), Proof::Waiting as u32);
}

#[test]
fn a_reference_is_confirmed_by_a_person_and_each_one_anew() {
    let mut bench = bench(|t| t.replace("capture: first", "capture: first, capture_seen: 1"));
    let cloud = head(&camera_from_body());
    assert_eq!(feed(&mut bench, &cloud).report.confirmed, 0);
    confirm(&mut bench, Verb::Arm);
    assert_eq!(feed(&mut bench, &cloud).report.confirmed, 0);
    confirm(&mut bench, Verb::Confirm);
    assert_eq!(feed(&mut bench, &cloud).report.confirmed, 1);
    command(&mut bench, Verb::Capture);
    let element = feed(&mut bench, &cloud);
    assert_eq!((element.report.reference, element.report.confirmed), (2, 0));
}
