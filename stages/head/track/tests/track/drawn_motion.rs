//! Motion of heads in scenes of the virtual rig that are drawn by chance: every setting, other views, sizes and motions.
//!
//! `$STILLPOINT_SCENES` says which are drawn (`drawn::numbers`).

use crate::drawn::{Drawn, drawn, numbers};
use crate::rendered::errors;
use crate::scene::{Frame, KINECT_V1, KINECT_V2, STRUCTURED};
use chacha20::ChaCha8Rng;
use chacha20::rand_core::SeedableRng;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand::RngExt;
use stillpoint_rig::setting::SETTINGS;
use stillpoint_segment::{Cloud, FaceParams, FaceSegmenter};
use stillpoint_track::HeadTracker;

/// Frames of a trajectory.
const FRAMES: usize = 8;
/// What structured light is held to, as on the rendered sets: mm, degrees.
const BOUNDS: [f64; 2] = [0.3, 0.15];

/// From where the head was drawn to another pose, as far as in figure 4.11: up to 12 mm and 10 degrees.
fn trajectory(scene: &Drawn, number: u64) -> Vec<Isometry3<f64>> {
    let mut rng = ChaCha8Rng::seed_from_u64(2000 + number);
    let mut within = |most: f64| rng.random_range(-most..most);
    let shift = Vector3::new(within(4e-3), within(4e-3), within(5.75e-3) + 5.75e-3);
    let turns = [2.0, 10.0, 2.0].map(|most: f64| within(most.to_radians()));
    let start = scene.couch_from_head;
    let moved = |part: f64| {
        let [pitch, roll, yaw] = turns.map(|angle| part * angle);
        let turn = UnitQuaternion::from_euler_angles(pitch, roll, yaw);
        let place = Translation3::from(start.translation.vector + part * shift);
        Isometry3::from_parts(place, turn * start.rotation)
    };
    (0..FRAMES).map(|k| moved(k as f64 / (FRAMES - 1) as f64)).collect()
}

/// The head's poses as the chain finds them, in the couch's frame, and the least intersection over union of the faces; or
/// why a frame has none.
fn found(scene: &Drawn, truth: &[Isometry3<f64>], number: u64) -> Result<(Vec<Isometry3<f64>>, f64), String> {
    let mut segmenter = FaceSegmenter::new(FaceParams::default()).unwrap();
    let mut tracker = HeadTracker::default();
    let mut rng = ChaCha8Rng::seed_from_u64(number);
    let (mut poses, mut least) = (Vec::new(), f64::INFINITY);
    let camera = &scene.couch_from_camera;
    for (k, couch_from_head) in truth.iter().enumerate() {
        let seed = 100 * number + k as u64;
        let frame = Frame::of(&scene.kind, camera, &scene.scene, scene.scale, couch_from_head, seed);
        let cloud = Cloud { points: &frame.cloud, width: frame.width };
        let face = segmenter.segment(cloud, &mut rng).face.map_err(|why| format!("frame {k}: {why}"))?;
        least = least.min(frame.iou(face));
        let points: Vec<_> =
            face.iter().map(|&i| Vector3::from(frame.cloud[i as usize].map(f64::from))).collect();
        let time = k as u64 * 100_000_000;
        if k == 0 {
            tracker.capture(&points, time).map_err(|why| format!("frame {k}: {why}"))?;
        }
        let tracked = tracker.track(&points, time).map_err(|why| format!("frame {k}: {why}"))?;
        poses.push(camera * tracked.current_from_reference * camera.inverse() * truth[0]);
    }
    Ok((poses, least))
}

#[test]
fn motion_is_found_in_scenes_drawn_by_chance() {
    let (mut all, mut failures) = (Vec::new(), Vec::new());
    for number in numbers(15) {
        let scene = drawn(number);
        let truth = trajectory(&scene, number);
        let bound = scene.kind.name == STRUCTURED.name;
        let (poses, iou) = match found(&scene, &truth, number) {
            Ok(found) => found,
            Err(why) => {
                failures.extend(bound.then(|| format!("{}: {why}", scene.about)));
                eprintln!("{} {why}", scene.about);
                continue;
            }
        };
        let (shift, turn) = errors(&poses, &truth);
        let most = [shift, turn].map(|axes| axes.into_iter().fold(0.0, f64::max));
        let over = most[0] > BOUNDS[0] || most[1] > BOUNDS[1];
        if over {
            eprintln!("{} iou {iou:.3}: {shift:.3?} mm, {turn:.3?} degrees", scene.about);
        }
        failures.extend((bound && over).then(|| format!("{}: {shift:.3?}, {turn:.3?}", scene.about)));
        all.push((scene.kind.name, scene.setting, most));
    }
    for kind in [STRUCTURED, KINECT_V1, KINECT_V2] {
        for setting in SETTINGS {
            let of: Vec<_> = all.iter().filter(|a| (a.0, a.1) == (kind.name, setting)).map(|a| a.2).collect();
            let summed = |i: usize| {
                let mut values: Vec<f64> = of.iter().map(|most| most[i]).collect();
                values.sort_by(f64::total_cmp);
                values.get(values.len() / 2).copied().zip(values.last().copied())
            };
            let Some(((mm, mm_most), (degrees, degrees_most))) = summed(0).zip(summed(1)) else { continue };
            let count = of.len();
            let name = kind.name;
            eprintln!(
                "{name:10} {setting:?}: {count}, mm {mm:.3}, at most {mm_most:.3}; degrees {degrees:.3}, at most {degrees_most:.3}"
            );
        }
    }
    assert!(failures.is_empty(), "{} of {}: {failures:#?}", failures.len(), all.len());
}
