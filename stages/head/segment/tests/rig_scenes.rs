//! The head among pads, pillow and shoulders that it touches, in scenes of the virtual rig.
//!
//! Where `$STILLPOINT_PICTURES` names a folder, each scene's worst frame is drawn there.

#![allow(clippy::unwrap_used, clippy::panic)]

use crate::picture::draw;
use crate::scene::{Frame, KINECT_V1, KINECT_V2, Kind, STRUCTURED};
use chacha20::ChaCha8Rng;
use chacha20::rand_core::SeedableRng;
use nalgebra::Vector3;
use stillpoint_rig::camera::couch_from_camera;
use stillpoint_rig::setting::{SETTINGS, Setting};
use stillpoint_rig::trajectory::{Motion, Trajectory};
use stillpoint_segment::{Cloud, FaceParams, FaceSegmenter};

/// A camera: place over the couch in metres, angles in degrees.
struct Camera {
    kind: Kind,
    from: &'static str,
    at: [f64; 3],
    degrees: [f64; 3],
}

const CAMERAS: [Camera; 4] = [
    Camera { kind: STRUCTURED, from: "the feet", at: [0.0, -0.48, 0.59], degrees: [45.0, 0.0, 0.0] },
    Camera { kind: KINECT_V1, from: "the feet", at: [0.05, -0.52, 0.66], degrees: [42.0, 0.0, 3.0] },
    Camera { kind: KINECT_V2, from: "the feet", at: [0.0, -0.45, 0.62], degrees: [40.0, 0.0, 0.0] },
    Camera { kind: STRUCTURED, from: "the side", at: [0.35, -0.30, 0.75], degrees: [22.0, -25.0, 0.0] },
];

fn frame(camera: &Camera, setting: Setting, scale: f64, seed: u64) -> Frame {
    let pose = couch_from_camera(Vector3::from(camera.at), camera.degrees.map(f64::to_radians));
    let script = Trajectory::new(Motion::Steps, seed, setting.rest(scale));
    let head = script.couch_from_head(15.0);
    Frame::of(&camera.kind, &pose, &setting.scene(scale).unwrap(), scale, &head, seed)
}

#[test]
fn head_is_found_among_what_it_touches() {
    let mut segmenter = FaceSegmenter::new(FaceParams::default()).unwrap();
    let (mut all, mut least) = (Vec::new(), 1.0_f64);
    for (number, camera) in CAMERAS.iter().enumerate() {
        for setting in SETTINGS {
            let mut ious = Vec::new();
            let mut worst = 2.0;
            for scale in [0.8, 0.9, 1.0, 1.1, 1.2] {
                let frame = frame(camera, setting, scale, number as u64);
                let mut rng = ChaCha8Rng::seed_from_u64(0);
                let seen = segmenter.segment(Cloud { points: &frame.cloud, width: frame.width }, &mut rng);
                let face = seen.face.unwrap_or(&[]);
                let iou = frame.iou(face);
                ious.push(iou);
                if iou < worst {
                    worst = iou;
                    draw(&format!("{number}-{setting:?}"), &frame.cloud, frame.width, &frame.head, face);
                }
            }
            let mean = ious.iter().sum::<f64>() / ious.len() as f64;
            let numbers: Vec<String> = ious.iter().map(|i| format!("{i:.3}")).collect();
            eprintln!(
                "{:10} from {:8} {:10} mean {mean:.3}  {}",
                camera.kind.name,
                camera.from,
                format!("{setting:?}"),
                numbers.join(" ")
            );
            least = least.min(worst);
            all.extend(ious);
        }
    }
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    eprintln!("{} frames: mean {mean:.4}, least {least:.4}", all.len());
    assert!(mean >= 0.93 && least >= 0.85, "mean {mean}, least {least}");
}
