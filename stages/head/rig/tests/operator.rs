//! `rig.camera` in the simulated executor.

#![allow(clippy::unwrap_used, clippy::panic)]

use stillpoint_operator::Registry;
use stillpoint_operator::files::MemoryFiles;
use stillpoint_samples::{DepthImage, Pose};
use stillpoint_testing::{Bench, Run, run};

const TEXT: &str = "
stillpoint: 1
name: rig
seed: 7
frames: { camera: { parent: couch, at: [0 mm, -480 mm, 590 mm], rotation: [-135 deg, 0 deg, 0 deg] } }
operators:
  rig: { use: rig.camera, every: 100 ms, frame: camera, params: { motion: nods, width: 160 px, height: 120 px, focal_length: 141 px } }
";

fn rig(text: &str) -> Run {
    run(text, &Registry::new(&[stillpoint_rig::STAGES]), &MemoryFiles::default(), 1000).unwrap()
}

#[test]
fn each_tick_sends_an_image_and_the_exact_pose_of_its_moment() {
    let run = rig(TEXT);
    let (images, poses) = (run.samples::<DepthImage>("rig.depth"), run.samples::<Pose>("rig.truth"));
    assert_eq!((images.len(), poses.len()), (10, 10));
    for (image, pose) in images.iter().zip(&poses) {
        assert_eq!((image.header.stamp, image.header.origin), (pose.header.stamp, pose.header.stamp));
        assert_eq!((image.body.width, image.body.height, image.elements.len()), (160, 120, 19_200));
        let seen = image.elements.iter().filter(|c| **c > 0).count();
        assert!(seen > 5000, "{seen} pixels have a depth");
        let q = pose.first().unwrap().orientation;
        assert!((q.iter().map(|c| c * c).sum::<f64>() - 1.0).abs() < 1e-12 && q[0] > 0.0);
        assert_eq!(pose.first().unwrap().covariance, [0.0; 36]);
    }
    assert_eq!(run.graph.operators[0].outputs[1].frame.as_deref(), Some("couch"));
}

#[test]
fn the_script_begins_at_the_first_activation() {
    let begin = rig(TEXT).samples::<Pose>("rig.truth")[0].first().unwrap().position;
    let script = stillpoint_rig::trajectory::Trajectory::new(
        stillpoint_rig::trajectory::Motion::Nods,
        7,
        stillpoint_rig::trajectory::rest_on_pad(),
    );
    let expected: [f64; 3] = script.couch_from_head(0.0).translation.vector.into();
    assert_eq!(begin, expected);
}

#[test]
fn the_bytes_depend_on_the_seed_and_on_nothing_else() {
    let depth = |text: &str| rig(text).bytes("rig.depth");
    assert!(depth(TEXT) == depth(TEXT));
    assert!(depth(TEXT) != depth(&TEXT.replace("seed: 7", "seed: 8")));
    let padded = |bytes| {
        let mut bench = Bench::new(TEXT, "rig", stillpoint_rig::STAGES, &MemoryFiles::default()).unwrap();
        bench = bench.padded(bytes);
        (0..3).flat_map(|_| bench.tick().bytes()).collect::<Vec<u8>>()
    };
    assert!(padded(0) == padded(13));
}

#[test]
fn another_script_seed_moves_the_head_otherwise() {
    let truth = |text: &str| rig(text).bytes("rig.truth");
    let other = TEXT.replace("motion: nods,", "motion: nods, seed: 8,");
    assert!(truth(TEXT) != truth(&other));
}

#[test]
fn a_camera_that_hangs_on_no_couch_is_refused_with_what_to_do() {
    let text = TEXT.replace("parent: couch", "parent: ceiling");
    let registry = Registry::new(&[stillpoint_rig::STAGES]);
    let error = run(&text, &registry, &MemoryFiles::default(), 100).err().unwrap();
    assert!(
        error.contains("place the frame `camera` in `frames` so that it is connected to `couch`"),
        "{error}"
    );
}
