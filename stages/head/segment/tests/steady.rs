//! What the chain needs from frame to frame: no memory, and no thread's help.

#![allow(clippy::unwrap_used, clippy::panic)]

use chacha20::ChaCha8Rng;
use chacha20::rand_core::SeedableRng;
use nalgebra::Vector3;
use stillpoint_ingest::depth::{Intrinsics, deproject};
use stillpoint_rig::camera::{Pinhole, couch_from_camera};
use stillpoint_rig::head::Head;
use stillpoint_rig::noise::{NoiseModel, NoiseParams};
use stillpoint_rig::render::Renderer;
use stillpoint_rig::sensor::DepthSensor;
use stillpoint_rig::setting::Setting;
use stillpoint_rig::trajectory::{Motion, Trajectory};
use stillpoint_segment::mls::MlsParams;
use stillpoint_segment::outliers::OutlierParams;
use stillpoint_segment::{Cloud, FaceParams, FaceSegmenter, Seen};

const WIDTH: usize = 320;

/// A head that nods among pads, pillow and shoulders, as a Kinect of the first kind sees it.
fn frames(count: u64) -> Vec<Vec<[f32; 3]>> {
    let pinhole = Pinhole::new(288.0, 288.0, 159.5, 119.5, WIDTH, 240).unwrap();
    let pose = couch_from_camera(Vector3::new(0.0, -0.5, 0.64), [45_f64.to_radians(), 0.0, 0.0]);
    let setting = Setting::Patient;
    let mut renderer =
        Renderer::new(pinhole, &pose, &setting.scene(1.0).unwrap(), Head::new(1.0).unwrap()).unwrap();
    let mut sensor = DepthSensor::new(&pinhole, NoiseModel::new(NoiseParams::kinect_v1()).unwrap());
    let script = Trajectory::new(Motion::Nods, 3, setting.rest(1.0));
    let camera = Intrinsics { fx: 288.0, fy: 288.0, cx: 159.5, cy: 119.5, metres_per_count: 1e-4 };
    let frame = |number: u64| {
        let view = renderer.render(&script.couch_from_head(number as f64 * 0.5)).unwrap();
        let mut depth = vec![0; pinhole.pixels()];
        sensor.sense(view, &mut ChaCha8Rng::seed_from_u64(number), &mut depth).unwrap();
        let mut points = vec![[0.0; 3]; depth.len()];
        deproject(&depth, WIDTH, 240, &camera, &mut points).unwrap();
        points
    };
    (0..count).map(frame).collect()
}

/// All steps, those that are left out by default, too.
fn all_steps() -> FaceParams {
    FaceParams {
        leaf: 0.008,
        outliers: Some(OutlierParams { neighbours: 20, deviations: 2.0, cell: 0.016 }),
        smoothing: Some(MlsParams { neighbours: 20, deviations: 1.0, tolerance: 0.01, cell: 0.016 }),
        ..FaceParams::default()
    }
}

/// The face of each frame.
fn faces(params: FaceParams, frames: &[Vec<[f32; 3]>]) -> Vec<Vec<u32>> {
    let mut segmenter = FaceSegmenter::new(params).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let face = |points: &Vec<[f32; 3]>| {
        segmenter.segment(Cloud { points, width: WIDTH }, &mut rng).face.unwrap().to_vec()
    };
    frames.iter().map(face).collect()
}

#[test]
fn frames_like_earlier_ones_take_no_memory() {
    let frames = frames(4);
    for params in [FaceParams::default(), all_steps()] {
        let mut segmenter = FaceSegmenter::new(params).unwrap();
        for round in 0..3 {
            for points in &frames {
                // The same random numbers, so that each round does the same.
                let mut rng = ChaCha8Rng::seed_from_u64(1);
                let cloud = Cloud { points, width: WIDTH };
                let taken = allocation_counter::measure(|| {
                    assert!(segmenter.segment(cloud, &mut rng).face.is_ok());
                });
                assert!(round < 2 || taken.count_total == 0, "{taken:?} in round {round}");
            }
        }
    }
}

#[test]
fn same_frame_again_has_the_same_findings_and_takes_no_memory() {
    let frames = frames(3);
    for params in [FaceParams::default(), all_steps()] {
        let (mut segmenter, mut living) =
            (FaceSegmenter::new(params).unwrap(), FaceSegmenter::new(params).unwrap());
        let cloud = |points| Cloud { points, width: WIDTH };
        let findings = |seen: &Seen<'_>| (format!("{seen:?}"), seen.face.unwrap().to_vec());
        for (number, points) in frames.iter().enumerate() {
            let mut rng = ChaCha8Rng::seed_from_u64(number as u64);
            let first = findings(&segmenter.segment(cloud(points), &mut rng));
            for seed in 10..13 {
                // Other random numbers, as each activation has.
                let mut rng = ChaCha8Rng::seed_from_u64(seed);
                let taken = allocation_counter::measure(|| {
                    assert!(segmenter.segment(cloud(points), &mut rng).face.is_ok());
                });
                // The first time there are two frames of the size.
                assert!(seed == 10 || taken.count_total == 0, "{taken:?}, {seed}");
                assert!(findings(&segmenter.segment(cloud(points), &mut rng)) == first, "frame {number}");
            }
            // A frame is searched as if none had been repeated.
            let mut rng = ChaCha8Rng::seed_from_u64(number as u64);
            assert!(findings(&living.segment(cloud(points), &mut rng)) == first, "frame {number}");
        }
    }
}

#[test]
fn points_of_the_same_voxels_in_another_order_are_found_where_they_are() {
    let frame = frames(1).remove(0);
    let dense: Vec<[f32; 3]> = frame.into_iter().filter(|p| p[0].is_finite()).collect();
    let late: Vec<[f32; 3]> = std::iter::once([f32::NAN; 3]).chain(dense.iter().copied()).collect();
    let mut segmenter = FaceSegmenter::new(FaceParams::default()).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let face = segmenter.segment(Cloud::unorganised(&dense), &mut rng).face.unwrap().to_vec();
    let shifted = segmenter.segment(Cloud::unorganised(&late), &mut rng).face.unwrap();
    assert!(face.iter().map(|place| place + 1).eq(shifted.iter().copied()));
}

#[test]
fn other_threads_change_nothing() {
    let frames = frames(2);
    for params in [FaceParams::default(), all_steps()] {
        let alone = faces(params, &frames);
        let frames = &frames;
        std::thread::scope(|scope| {
            let together: Vec<_> = (0..4).map(|_| scope.spawn(move || faces(params, frames))).collect();
            for thread in together {
                assert!(thread.join().unwrap() == alone);
            }
        });
    }
}
