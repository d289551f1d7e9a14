//! The head in scenes of the virtual rig that are drawn by chance: camera, its place and tilt, head, what it lies on and
//! touches, and what lies about.
//!
//! `$STILLPOINT_SCENES` says how many are drawn; `$STILLPOINT_PICTURES` names a folder for pictures of the worst.

#![allow(clippy::unwrap_used, clippy::panic)]

use std::f64::consts::{PI, TAU};

use crate::picture::draw;
use crate::scene::{Frame, KINECT_V1, KINECT_V2, Kind, STRUCTURED};
use chacha20::ChaCha8Rng;
use chacha20::rand_core::SeedableRng;
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use rand::{Rng, RngExt};
use stillpoint_rig::scene::{Form, Label, Object, Scene};
use stillpoint_rig::setting::{SETTINGS, Setting};
use stillpoint_rig::shape::{Cuboid, Ellipsoid};
use stillpoint_segment::{Cloud, FaceParams, FaceSegmenter, Rejection};

/// A scene that was drawn.
#[derive(Clone)]
struct Drawn {
    kind: Kind,
    couch_from_camera: Isometry3<f64>,
    setting: Setting,
    scene: Scene,
    scale: f64,
    couch_from_head: Isometry3<f64>,
    /// In words.
    about: String,
}

/// A camera at `at` that looks to `target`, turned about its axis.
fn look(at: Vector3<f64>, target: Vector3<f64>, turn: f64) -> Isometry3<f64> {
    let z = (target - at).normalize();
    let down = (-Vector3::y() + z * z.y).normalize();
    let axes = Matrix3::from_columns(&[down.cross(&z), down, z]);
    let axes = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn);
    Isometry3::from_parts(Translation3::from(at), axes * turn)
}

fn drawn(number: u64) -> Drawn {
    let mut rng = ChaCha8Rng::seed_from_u64(1000 + number);
    let rng = &mut rng;
    let kind = [STRUCTURED, KINECT_V1, KINECT_V2][number as usize % 3];
    let setting = SETTINGS[number as usize / 3 % SETTINGS.len()];
    let scale = rng.random_range(0.9..1.1);
    let mut scene = setting.scene(scale).unwrap();
    let left_lying = rng.random_range(0..4);
    scene.add((0..left_lying).map(|_| thing(rng)));
    // The head turns to a side more than it nods.
    let mut within = |most: f64| rng.random_range(-most..most);
    let turned = UnitQuaternion::from_euler_angles(within(0.1), within(0.35), within(0.1));
    let mut couch_from_head = setting.rest(scale);
    couch_from_head.translation.vector += Vector3::new(within(5e-3), within(5e-3), within(4e-3) + 4e-3);
    couch_from_head.rotation = turned * couch_from_head.rotation;
    let target = couch_from_head.translation.vector + Vector3::new(within(0.04), within(0.04), 0.0);
    let tilt: f64 = rng.random_range(0.0..0.85);
    let around: f64 = rng.random_range(-0.6 * PI..0.6 * PI);
    // What is nearer than a camera is made for, it does not see.
    let least = target.z + ((kind.noise)().near + 0.17) * tilt.cos();
    let height: f64 = rng.random_range(0.5..0.9_f64).max(least);
    let aside = (height - target.z) * tilt.tan();
    let at = Vector3::new(target.x + aside * around.sin(), target.y - aside * around.cos(), height);
    let turn = rng.random_range(-0.3..0.3)
        + if number % 4 == 3 { TAU / 4.0 * f64::from(rng.random_range(1..4)) } else { 0.0 };
    let about = format!(
        "{number:4} {:10} {:9} scale {scale:.2}, {height:.2} m over the couch, {:.0} degrees off, {:.0} around, turned {:.0}",
        kind.name,
        format!("{setting:?}"),
        tilt.to_degrees(),
        around.to_degrees(),
        turn.to_degrees()
    );
    Drawn { kind, couch_from_camera: look(at, target, turn), setting, scene, scale, couch_from_head, about }
}

/// A thing on the couch, away from the head.
fn thing(rng: &mut impl Rng) -> Object {
    let side = if rng.random_range(0..2) == 0 { -1.0 } else { 1.0 };
    let half = Vector3::from_fn(|_, _| rng.random_range(0.015..0.05));
    let place = [side * rng.random_range(0.19..0.25), rng.random_range(-0.35..0.30), half.z * 0.8];
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), rng.random_range(0.0..PI));
    let at = Isometry3::from_parts(Translation3::from(place), turn);
    let form = if rng.random_range(0..2) == 0 {
        Form::Ellipsoid(Ellipsoid::new(at, half).unwrap())
    } else {
        Form::Cuboid(Cuboid::new(at, half).unwrap())
    };
    Object { label: Label::Clutter, form }
}

#[test]
fn head_is_found_in_scenes_drawn_by_chance() {
    let many = std::env::var("STILLPOINT_SCENES").ok().and_then(|n| n.parse().ok()).unwrap_or(60);
    let mut found = Vec::new();
    for number in 0..many {
        let d = drawn(number);
        let frame = Frame::of(&d.kind, &d.couch_from_camera, &d.scene, d.scale, &d.couch_from_head, number);
        let mut segmenter = FaceSegmenter::new(FaceParams::default()).unwrap();
        let cloud = Cloud { points: &frame.cloud, width: frame.width };
        let seen = segmenter.segment(cloud, &mut ChaCha8Rng::seed_from_u64(number));
        let plane = seen.plane.map_or(f64::NAN, |fit| {
            let up = d.couch_from_camera.rotation.inverse() * Vector3::z();
            fit.plane.normal.angle(&up).to_degrees()
        });
        let rejection = seen.face.err().map(|r| r.to_string()).unwrap_or_default();
        let face = seen.face.unwrap_or(&[]);
        let iou = frame.iou(face);
        if iou < 0.9 {
            eprintln!("{iou:.3} {} plane off by {plane:.1} degrees {rejection}", d.about);
            draw(&format!("drawn-{number}"), &frame.cloud, frame.width, &frame.head, face);
        }
        found.push((d.kind.name, d.setting, iou));
    }
    for setting in SETTINGS {
        for kind in [STRUCTURED, KINECT_V1, KINECT_V2] {
            let ious: Vec<f64> =
                found.iter().filter(|f| (f.0, f.1) == (kind.name, setting)).map(|f| f.2).collect();
            let least = ious.iter().copied().fold(f64::INFINITY, f64::min);
            let mean = ious.iter().sum::<f64>() / ious.len() as f64;
            eprintln!("{:10} {setting:?}: {} mean {mean:.3}, least {least:.3}", kind.name, ious.len());
        }
    }
    let mean = found.iter().map(|f| f.2).sum::<f64>() / found.len() as f64;
    let least = found.iter().map(|f| f.2).fold(1.0, f64::min);
    eprintln!("{} scenes: mean {mean:.4}, least {least:.4}", found.len());
    assert!(mean >= 0.93 && least >= 0.85, "mean {mean}, least {least}");
}

/// What is found in a scene: the face's points or why there is none.
fn segmented(frame: &Frame, seed: u64) -> Result<Vec<u32>, Rejection> {
    let mut segmenter = FaceSegmenter::new(FaceParams::default()).unwrap();
    let cloud = Cloud { points: &frame.cloud, width: frame.width };
    segmenter.segment(cloud, &mut ChaCha8Rng::seed_from_u64(seed)).face.map(<[u32]>::to_vec)
}

#[test]
fn pads_and_pillows_without_a_head_are_none() {
    let (mut found, mut many) = (Vec::new(), 0);
    for number in 0..30 {
        let mut d = drawn(number);
        if matches!(d.setting, Setting::Shoulders | Setting::Patient) {
            continue;
        }
        many += 1;
        d.couch_from_head.translation.vector.z = -20.0;
        let frame = Frame::of(&d.kind, &d.couch_from_camera, &d.scene, d.scale, &d.couch_from_head, number);
        if let Ok(face) = segmented(&frame, number) {
            draw(&format!("empty-{number}"), &frame.cloud, frame.width, &frame.head, &face);
            found.push(d.about);
        }
    }
    eprintln!("{} of {many}: {found:#?}", found.len());
    assert!(found.len() <= 1, "{found:#?}");
}

#[test]
fn half_a_head_at_the_image_edge_is_found_or_refused() {
    let (mut ious, mut refused) = (Vec::new(), 0);
    for number in 0..30 {
        let mut d = drawn(number);
        // The image's edge runs through the head.
        let aside = d.kind.size[(number % 2) as usize] as f64 / 2.0 / d.kind.focal;
        let turn = if number % 4 < 2 { aside.atan() } else { -aside.atan() };
        let axis = if number % 2 == 0 { Vector3::y_axis() } else { Vector3::x_axis() };
        d.couch_from_camera *= UnitQuaternion::from_axis_angle(&axis, turn);
        let frame = Frame::of(&d.kind, &d.couch_from_camera, &d.scene, d.scale, &d.couch_from_head, number);
        match segmented(&frame, number) {
            Ok(face) => {
                let iou = frame.iou(&face);
                if iou < 0.9 {
                    eprintln!("{iou:.3} {}", d.about);
                    draw(&format!("half-{number}"), &frame.cloud, frame.width, &frame.head, &face);
                }
                ious.push(iou);
            }
            Err(_) => refused += 1,
        }
    }
    let mean = ious.iter().sum::<f64>() / ious.len() as f64;
    eprintln!("{refused} refused, {} found: mean {mean:.3}", ious.len());
    assert!(ious.len() >= 15 && mean > 0.9, "{refused} refused, mean {mean}");
}
