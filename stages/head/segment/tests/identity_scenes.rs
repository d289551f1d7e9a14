//! Which thing is taken for the head, on patients drawn by chance. `$STILLPOINT_SCENES` says which are drawn.

#![allow(clippy::unwrap_used, clippy::panic)]

use chacha20::ChaCha8Rng;
use chacha20::rand_core::SeedableRng;
use stillpoint_rig::patient::drawn::{EXTRAS, Extra, patient};
use stillpoint_rig::patient::worn::Worn;
use stillpoint_rig::scene::Scene;
use stillpoint_segment::identity::{Candidate, IdentityParams, Region};
use stillpoint_segment::{Cloud, FaceParams, FaceSegmenter, Rejection};

use crate::drawn::numbers;
use crate::scene::Frame;

/// Part of the head that a face may hold else, and must.
const PURE: f64 = 0.75;

#[test]
fn nothing_but_the_head_is_taken_for_it() {
    let (mut wrong, mut missed, mut due, mut taken) = (Vec::new(), Vec::new(), 0, 0);
    let mut by_extra = EXTRAS.map(|_| [0; 4]);
    for number in numbers(200) {
        let p = patient(number).unwrap();
        let frame = Frame::of(&p.kind, &p.couch_from_camera, &p.scene, p.scale, &p.couch_from_head, number);
        let bare = Scene::new(Vec::new(), -0.85);
        let alone = Frame::of(&p.kind, &p.couch_from_camera, &bare, p.scale, &p.couch_from_head, number);
        let count = |frame: &Frame| frame.head.iter().filter(|h| **h).count() as f64;
        let shown = count(&frame) / count(&alone).max(1.0);
        let identity = IdentityParams {
            couch_from_cloud: p.couch_from_camera,
            region: Some(Region::DEFAULT),
            needs_body: true,
            margin: 0.2,
        };
        let mut segmenter =
            FaceSegmenter::new(FaceParams { identity: Some(identity), ..FaceParams::default() }).unwrap();
        let cloud = Cloud { points: &frame.cloud, width: frame.width };
        let seen = segmenter.segment(cloud, &mut ChaCha8Rng::seed_from_u64(number));
        let place = EXTRAS.iter().position(|e| *e == p.extra).unwrap();
        let is_time = p.has_head() && p.is_plain() && shown >= 2.0 / 3.0 && p.off_front <= 60.0;
        due += usize::from(is_time);
        by_extra[place][0] += 1;
        match seen.face {
            Ok(face) => {
                let inside = face.iter().filter(|i| frame.head[**i as usize]).count() as f64;
                let purity = inside / face.len().max(1) as f64;
                taken += usize::from(is_time);
                by_extra[place][1] += 1;
                // A fist on the chin is cut with it; that it is none of the head, its motion tells.
                let pure = if p.extra == Extra::Fist { 0.5 } else { PURE };
                if purity < pure {
                    by_extra[place][2] += 1;
                    wrong.push(format!("purity {purity:.2} {}", p.about));
                    if tells() {
                        report("WRONG", &p.about, seen.candidates);
                    }
                }
            }
            Err(why) if is_time => {
                by_extra[place][3] += 1;
                missed.push(format!("{} shown {shown:.2}: {why}", p.about));
                if tells() {
                    report("MISSED", &p.about, seen.candidates);
                }
                assert!(!matches!(why, Rejection::TooFewVoxels { .. }), "{why}");
            }
            Err(_) => {}
        }
    }
    for (extra, [all, taken, wrong, missed]) in EXTRAS.iter().zip(by_extra) {
        eprintln!("{extra:?}: {all} scenes, {taken} taken, {wrong} wrong, {missed} missed");
    }
    eprintln!("{taken} of {due} due taken, {} wrong: {wrong:#?}", wrong.len());
    assert!(wrong.is_empty(), "{wrong:#?}");
    assert!(taken as f64 >= 0.93 * due as f64, "{taken} of {due}: {missed:#?}");
}

/// Part of the face of a patient (m) that lies on the head with what is worn on it, and part of the head in the face; or
/// why there is no face.
fn shares(number: u64, worn: Worn, seed: u64) -> Result<[f64; 2], String> {
    let p = patient(number).unwrap();
    let head = worn.on_head(p.scale).unwrap();
    let frame = Frame::of_head(&p.kind, &p.couch_from_camera, &p.scene, head, &p.couch_from_head, seed);
    let identity = IdentityParams {
        couch_from_cloud: p.couch_from_camera,
        region: Some(Region::DEFAULT),
        needs_body: true,
        margin: 0.2,
    };
    let params = FaceParams { identity: Some(identity), ..FaceParams::default() };
    let mut segmenter = FaceSegmenter::new(params).unwrap();
    let cloud = Cloud { points: &frame.cloud, width: frame.width };
    let seen = segmenter.segment(cloud, &mut ChaCha8Rng::seed_from_u64(seed));
    let face = seen.face.map_err(|why| why.to_string())?;
    let inside = face.iter().filter(|i| frame.head[**i as usize]).count() as f64;
    let measured = (0..frame.cloud.len()).filter(|i| frame.head[*i] && frame.cloud[*i][2].is_finite());
    Ok([inside / face.len().max(1) as f64, inside / measured.count().max(1) as f64])
}

#[test]
fn a_jaw_or_a_neck_below_thick_hair_is_not_taken_for_the_head() {
    for number in [10_201, 10_202, 10_231, 10_352] {
        for seed in 0..2 {
            let [pure, whole] = shares(number, Worn::Hair, seed).unwrap();
            assert!(pure > 0.8 && whole > 0.7, "{number}: purity {pure:.2}, {whole:.2} of the head");
        }
    }
}

#[test]
fn a_fist_on_the_chin_is_not_taken_for_the_head() {
    for (number, worn) in [(10_122, Worn::Nothing), (10_273, Worn::Nothing), (10_064, Worn::Beard)] {
        for seed in 0..2 {
            if let Ok([pure, _]) = shares(number, worn, seed) {
                assert!(pure > 0.5, "{number}: purity {pure:.2}");
            }
        }
    }
}

#[test]
fn a_head_that_cannot_be_cut_from_an_arm_or_a_pad_is_refused() {
    for (number, worn) in [(10_267, Worn::Nothing), (14_190, Worn::Nothing)] {
        for seed in 0..2 {
            let why = shares(number, worn, seed).unwrap_err();
            assert!(why.contains("cannot be cut from what touches it"), "{number}: {why}");
        }
    }
}

/// A body without a head: as wide as its shoulders, it narrowed like a neck at the dent between them.
#[test]
fn two_shoulders_with_a_dent_between_are_not_taken_for_a_head() {
    for seed in [13, 25, 27] {
        assert!(shares(11_459, Worn::Nothing, seed).is_err(), "{seed}");
    }
}

#[test]
fn a_ball_beside_a_head_is_not_taken_for_it() {
    let found: Vec<f64> = [0, 5, 9, 14]
        .into_iter()
        .filter_map(|seed| shares(11_237, Worn::Nothing, seed).ok())
        .map(|[pure, _]| pure)
        .collect();
    assert!(found.len() > 1 && found.iter().all(|pure| *pure > 0.8), "{found:.2?}");
}

#[test]
fn thick_hair_beside_a_ball_is_no_arm() {
    for number in [10_442, 10_536, 10_756] {
        let [pure, whole] = shares(number, Worn::Hair, 0).unwrap();
        assert!(pure > 0.9 && whole > 0.9, "{number}: purity {pure:.2}, {whole:.2} of the head");
    }
}

/// One of them is of one thing with the next, and that one with a third.
#[test]
fn of_three_balls_of_one_head_no_two_are_rivals() {
    for number in [10_027, 10_081, 10_086] {
        let [pure, whole] = shares(number, Worn::Hair, 0).unwrap();
        assert!(pure > 0.9 && whole > 0.9, "{number}: purity {pure:.2}, {whole:.2} of the head");
    }
}

/// Whether wrong and missed scenes are told with their candidates.
fn tells() -> bool {
    std::env::var_os("STILLPOINT_TELL").is_some()
}

fn report(what: &str, about: &str, candidates: &[Candidate]) {
    eprintln!("{what} {about}");
    for c in candidates {
        eprintln!(
            "    {:.2?} r {:.3} size {:.2} valley {:.2} neck {:.2} area {:.3} width {:.2} midline {:.2} region {:.2} shape {:.2} alone {:.2}",
            c.place.as_slice(),
            c.ball.radius,
            c.size,
            c.valley,
            c.neck,
            c.body_area,
            c.body_width,
            c.midline,
            c.in_region,
            c.shape,
            c.alone
        );
    }
}
