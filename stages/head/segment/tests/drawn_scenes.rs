//! The head in scenes of the virtual rig that are drawn by chance.
//!
//! `$STILLPOINT_SCENES` says which are drawn (`drawn::numbers`); `$STILLPOINT_PICTURES` names a folder for pictures of the worst.

#![allow(clippy::unwrap_used, clippy::panic)]

use crate::drawn::{drawn, numbers};
use crate::picture::draw;
use crate::scene::{Frame, KINECT_V1, KINECT_V2, STRUCTURED};
use chacha20::ChaCha8Rng;
use chacha20::rand_core::SeedableRng;
use nalgebra::{UnitQuaternion, Vector3};
use stillpoint_rig::setting::{SETTINGS, Setting};
use stillpoint_segment::{Cloud, FaceParams, FaceSegmenter, Rejection};

#[test]
fn head_is_found_in_scenes_drawn_by_chance() {
    let mut found = Vec::new();
    for number in numbers(60) {
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

/// Once the pad was the head's: between the two it hardly goes down.
#[test]
fn a_face_turned_to_a_pad_is_cut_from_it() {
    for number in [78, 138, 334, 469, 798, 905, 1144] {
        let d = drawn(number);
        assert_eq!(d.setting, Setting::TightPads);
        let frame = Frame::of(&d.kind, &d.couch_from_camera, &d.scene, d.scale, &d.couch_from_head, number);
        let iou = frame.iou(&segmented(&frame, number).unwrap());
        assert!(iou > 0.96, "{iou:.3} {}", d.about);
    }
}

/// Each once failed, most of them at less than 0.85.
#[test]
fn heads_that_were_once_cut_badly_are_found() {
    let cases = [
        ("a ball through cranium and pad, broader than the head's", [10639, 12138, 12665].as_slice()),
        ("a neck of which less than half is seen", &[20215, 20719, 22525]),
        ("a neck beside a pillow for which many balls speak", &[20534, 21748, 22047]),
        ("a pad hardly parted from the face", &[11733, 20074, 22144]),
        ("a plane over pillow and shoulders, higher than the floor", &[20729, 30462]),
    ];
    for (about, numbers) in cases {
        for &number in numbers {
            let d = drawn(number);
            let frame =
                Frame::of(&d.kind, &d.couch_from_camera, &d.scene, d.scale, &d.couch_from_head, number);
            let iou = segmented(&frame, number).map_or(0.0, |face| frame.iou(&face));
            assert!(iou > 0.94, "{about}: {iou:.3} {}", d.about);
        }
    }
}

/// What is found in a scene: the face's points or why there is none.
#[allow(clippy::result_large_err)]
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
