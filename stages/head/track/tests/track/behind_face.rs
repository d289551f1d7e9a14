//! The planning CT as the reference of the face that `segment` cuts out, on patients drawn by chance: bodies, sizes,
//! surroundings and views of all kinds, each before its own CT and before the CT of another patient.
//!
//! `STILLPOINT_PATIENTS=10000..10200` says which are drawn.

use std::time::{Duration, Instant};

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use stillpoint_patient::Grid;
use stillpoint_patient::case::PatientPosition;
use stillpoint_patient::outline::{PatientSurface, Placing, march};
use stillpoint_rig::head::Head;
use stillpoint_rig::patient::drawn::{Extra, Patient, patient};
use stillpoint_rig::scene::Scene;
use stillpoint_segment::identity::{IdentityParams, Region};
use stillpoint_segment::{Cloud, FaceParams, FaceSegmenter};
use stillpoint_track::HeadTracker;
use stillpoint_track::planned::{Foreign, Limits, Planned, Registered};

use crate::planned::{GREATEST, LEAST, Random, SURFACE, difference, drawn};
use crate::scene::Frame;

/// Distance of the voxels of the CTs, and the air around the head, mm.
const SPACING_MM: f64 = 2.0;
const AROUND_MM: f64 = 6.0;
/// Heads below this part of the adult's size.
const SMALL: f64 = 0.7;

/// The outline of the CT of a head, with the isocentre at a place in the head, m.
fn outline_of(head: &Head, isocentre: &Vector3<f64>) -> PatientSurface {
    let in_patient = |p: Vector3<f64>| [1e3 * p.x, -1e3 * p.z, 1e3 * p.y];
    let (least, greatest) = head.extent();
    let [a, b] = [least, greatest].map(in_patient);
    let low: [f64; 3] = std::array::from_fn(|i| a[i].min(b[i]) - AROUND_MM);
    let counts =
        std::array::from_fn(|i| ((a[i].max(b[i]) + AROUND_MM - low[i]) / SPACING_MM).ceil() as usize + 1);
    let grid = Grid { counts, spacing_mm: [SPACING_MM; 3], origin_mm: low };
    let hu = |i: usize| {
        let [x, y, z] = grid.centre_mm(grid.voxel(i)).map(|c| 1e-3 * c);
        // A voxel that the skin halves is half air.
        let within = (0.5 + 1e3 * head.depth([x, z, -y]) / SPACING_MM).clamp(0.0, 1.0);
        (-1000.0 + 1000.0 * within) as f32
    };
    let values: Vec<f32> = (0..grid.len()).map(hu).collect();
    let placing = Placing { isocentre_mm: in_patient(*isocentre), position: PatientPosition::default() };
    PatientSurface { mesh: march(&grid, &values, -500.0), placing }
}

/// The numbers of the patients.
pub fn numbers() -> std::ops::Range<u64> {
    let asked = std::env::var("STILLPOINT_PATIENTS").ok();
    let range = asked.as_deref().and_then(|text| text.split_once(".."));
    let range = range.and_then(|(from, to)| Some(from.parse().ok()?..to.parse().ok()?));
    range.unwrap_or(10_000..10_008)
}

/// The face of a patient in the camera's frame, if a capture is due: one head, at most a third of it hidden, seen from
/// within 60 degrees of its front.
fn face_of(p: &Patient, number: u64) -> Option<Vec<Vector3<f64>>> {
    let frame =
        |scene: &Scene| Frame::of(&p.kind, &p.couch_from_camera, scene, p.scale, &p.couch_from_head, number);
    if !p.has_head() || !p.is_plain() || p.off_front > 60.0 {
        return None;
    }
    let (seen, alone) = (frame(&p.scene), frame(&Scene::new(Vec::new(), -0.85)));
    let count = |frame: &Frame| frame.head.iter().filter(|h| **h).count();
    if 3 * count(&seen) < 2 * count(&alone) {
        return None;
    }
    let identity = IdentityParams {
        couch_from_cloud: p.couch_from_camera,
        region: Some(Region::DEFAULT),
        needs_body: true,
        margin: 0.2,
    };
    let params = FaceParams { identity: Some(identity), ..FaceParams::default() };
    let mut segmenter = FaceSegmenter::new(params).unwrap();
    let cloud = Cloud { points: &seen.cloud, width: seen.width };
    let found = segmenter.segment(cloud, &mut Random::seed_from_u64(number));
    let points = found.face.ok()?.iter().map(|i| Vector3::from(seen.cloud[*i as usize].map(f64::from)));
    Some(points.collect())
}

/// Looks for a patient in a face, from a planned place within 150 mm and 40 degrees of the true one.
fn register(
    surface: &PatientSurface,
    p: &Patient,
    couch_from_iso: &Isometry3<f64>,
    face: &[Vector3<f64>],
    rng: &mut Random,
) -> (Result<Registered, Foreign>, Duration) {
    let mut unit = || Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0_f64)).normalize();
    let (aside, about) = (unit(), nalgebra::Unit::new_normalize(unit()));
    let (far, angle) = (rng.random_range(0.0..0.15), rng.random_range(0.0..40.0_f64).to_radians());
    let planned = Isometry3::from_parts(
        Translation3::from(couch_from_iso.translation.vector + far * aside),
        UnitQuaternion::from_axis_angle(&about, angle) * couch_from_iso.rotation,
    );
    let points = surface.about_isocentre(LEAST, GREATEST);
    let place = p.couch_from_camera.inverse() * planned;
    let known = Planned::new(&points, [LEAST, GREATEST], place, SURFACE, Limits::default()).unwrap();
    let begun = Instant::now();
    let found = known.register(face);
    (found, begun.elapsed())
}

#[test]
fn behind_the_segmentation_each_patient_is_found_by_their_own_ct_alone() {
    let (mut due, mut good, mut wrong, mut foreign, mut accepted) = (0, 0, 0, 0, 0);
    let (mut times, mut frames, mut worst) = (Vec::new(), Vec::new(), [0.0_f64; 2]);
    for number in numbers() {
        let p = patient(number).unwrap();
        let Some(face) = face_of(&p, number) else { continue };
        let mut rng = Random::seed_from_u64(900_000 + number);
        let own = Head::new(p.scale).unwrap();
        let isocentre = p.scale * Vector3::new(0.02, 0.045, 0.02);
        let surface = outline_of(&own, &isocentre);
        let couch_from_iso = p.couch_from_head * Translation3::from(isocentre);
        // A fist on the face is no reason to be found, and none to be found wrongly.
        let is_time = p.extra != Extra::Fist;
        due += usize::from(is_time);
        let (found, time) = register(&surface, &p, &couch_from_iso, &face, &mut rng);
        times.push(time);
        match &found {
            Ok(found) => {
                let at = p.couch_from_camera * found.camera_from_model;
                let mm = 1e3 * (at * Point3::origin() - couch_from_iso * Point3::origin()).norm();
                let degrees = at.rotation.angle_to(&couch_from_iso.rotation).to_degrees();
                // The face of a small head has few pixels.
                let most_degrees = if p.scale < SMALL { 0.5 } else { 0.3 };
                let is_good = mm <= 0.5 && degrees <= most_degrees;
                good += usize::from(is_good && is_time);
                wrong += usize::from(!is_good);
                worst = [worst[0].max(mm), worst[1].max(degrees)];
                eprintln!("{mm:.3} mm {degrees:.3} deg {} {:.2?}", p.about, found.fit);
                let begun = Instant::now();
                let mut tracker = HeadTracker::default();
                tracker.capture(&found.seen, 0).unwrap();
                assert!(tracker.track(&face, 0).is_ok());
                frames.push(time + begun.elapsed());
            }
            Err(why) => eprintln!("refused {}: {why} {:.2?}", p.about, why.fit()),
        }
        // Another patient's CT: of the same size, with parts moved and stretched.
        for _ in 0..20 {
            let amount = rng.random_range(0.02..0.2);
            let other = drawn(&own, &mut rng, amount);
            let differs = difference(&surface, &other);
            if differs >= 2.0 {
                foreign += 1;
                let theirs = outline_of(&other, &isocentre);
                if let (Ok(found), _) = register(&theirs, &p, &couch_from_iso, &face, &mut rng) {
                    accepted += 1;
                    eprintln!("ACCEPTED {differs:.2} mm {} {:?}", p.about, found.fit);
                }
                break;
            }
        }
    }
    times.sort();
    frames.sort();
    eprintln!(
        "{good} of {due} faces registered within 0.5 mm and 0.3 degrees (0.5 if the head is small), {wrong} beyond, worst {worst:.3?}; {accepted} of \
         {foreign} foreign CTs accepted"
    );
    let of = |times: &[Duration], part: usize| times.get(part * times.len().saturating_sub(1) / 100).copied();
    eprintln!(
        "registration {:.0?} median, {:.0?} longest; with the surface and the pose {:.0?}, {:.0?}",
        of(&times, 50),
        of(&times, 100),
        of(&frames, 50),
        of(&frames, 100)
    );
    assert!(due > 0 && foreign > 0, "{due} {foreign}");
    assert_eq!((wrong, accepted), (0, 0), "{good} of {due}");
    assert!(20 * good >= 19 * due - 20, "{good} of {due}");
}
