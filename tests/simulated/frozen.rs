//! A camera that sends the same image again and again: it is named and left out, whatever stands between it and the fusion.

use std::sync::OnceLock;

use stillpoint_operator::files::MemoryFiles;
use stillpoint_samples::{DepthImage, Health, Pose, Standing, Track};
use stillpoint_testing::{Run, run};

use crate::registry;

const FRAMES: usize = 60;
/// The first camera's image of 3.0 s comes again until 5.0 s.
const FROZEN: std::ops::Range<usize> = 30..50;

/// Two cameras over one head.
const RIG: &str = "
stillpoint: 1
name: rig
seed: 3
frames: { camera: { parent: couch, at: [0 mm, -480 mm, 590 mm], rotation: [-135 deg, 0 deg, 0 deg] } }
operators:
  first: { use: rig.camera, every: 100 ms, frame: camera, params: { motion: MOTION, width: 320 px, height: 240 px, focal_length: 283 px } }
  second: { use: rig.camera, every: 100 ms, frame: camera, params: { motion: MOTION, width: 320 px, height: 240 px, focal_length: 283 px } }
";

/// From their files to one track.
const FUSED: &str = "
stillpoint: 1
name: frozen
seed: 3
frames: { camera: { parent: couch, at: [0 mm, -480 mm, 590 mm], rotation: [-135 deg, 0 deg, 0 deg] } }
operators:
  first_cloud: { use: ingest.depth, every: 100 ms, frame: camera, params: { files: first, camera: LENS } }
  first_face: { use: segment.face, inputs: { cloud: first_cloud.cloud }, params: { body: waived } }
  first_head: { use: track.head, inputs: { face: first_face.face, rejection: first_face.rejection }, frame: couch }
  first: { use: estimate.kalman, inputs: { measurement: first_head.pose }, params: { follow: pose } }
  second_cloud: { use: ingest.depth, every: 100 ms, frame: camera, params: { files: second, camera: LENS } }
  second_face: { use: segment.face, inputs: { cloud: second_cloud.cloud }, params: { body: waived } }
  second_head: { use: track.head, inputs: { face: second_face.face, rejection: second_face.rejection }, frame: couch }
  second: { use: estimate.kalman, inputs: { measurement: second_head.pose }, params: { follow: pose } }
  fused: { use: estimate.fuse, every: 50 ms, inputs: { first: first.state, second: second.state }, params: { follow: pose } }
";
const LENS: &str = "{ fx: 283 px, fy: 283 px, cx: 159.5 px, cy: 119.5 px, depth_unit: 0.1 mm }";

fn png(counts: &[u16]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 320, 240);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    let big_endian: Vec<u8> = counts.iter().flat_map(|count| count.to_be_bytes()).collect();
    encoder.write_header().unwrap().write_image_data(&big_endian).unwrap();
    bytes
}

/// Heights of the head over the couch in truth, and what comes of two cameras of which the first freezes for 2 s.
fn seen(motion: &str) -> (Vec<f64>, Run) {
    let rig = run(&RIG.replace("MOTION", motion), &registry(), &MemoryFiles::default(), 6_000).unwrap();
    let mut retained = MemoryFiles::default();
    for camera in ["first", "second"] {
        let images = rig.samples::<DepthImage>(&format!("{camera}.depth"));
        assert_eq!(images.len(), FRAMES);
        for number in 0..FRAMES {
            let is_frozen = camera == "first" && FROZEN.contains(&number);
            let image = &images[if is_frozen { FROZEN.start } else { number }];
            retained.files.insert(format!("{camera}/{number:03}.png"), png(image.elements));
        }
    }
    let truth = rig.samples::<Pose>("first.truth").iter().map(|p| p.first().unwrap().position[2]).collect();
    let run = run(&FUSED.replace("LENS", LENS), &registry(), &retained, 6_000).unwrap();
    assert_eq!(run.failed(), [] as [&str; 0]);
    (truth, run)
}

fn at_rest() -> &'static (Vec<f64>, Run) {
    static SEEN: OnceLock<(Vec<f64>, Run)> = OnceLock::new();
    SEEN.get_or_init(|| seen("still"))
}

/// What is said of a sensor, each once.
fn course(run: &Run, sensor: usize) -> Vec<String> {
    let healths = run.samples::<Health>("fused.health");
    let mut course: Vec<String> = healths.iter().map(|h| h.elements[sensor].reason().to_owned()).collect();
    course.dedup();
    course
}

/// The first is frozen from its third repetition on, and then what `after` says; the second is used all the time, and the
/// fused track is its.
fn check(run: &Run, after: &[&str]) {
    let repeated = |filter: &str| -> Vec<u64> {
        run.samples::<Track>(&format!("{filter}.state")).iter().map(|t| t.first().unwrap().repeated).collect()
    };
    let expected = |frame: usize| if FROZEN.contains(&frame) { (frame - FROZEN.start) as u64 } else { 0 };
    assert!(repeated("first").into_iter().eq((0..FRAMES).map(expected)), "{:?}", repeated("first"));
    assert_eq!(repeated("second"), [0; FRAMES]);

    let courses = [0, 1].map(|sensor| course(run, sensor));
    let begun = courses.each_ref().map(|course| course.iter().skip_while(|reason| *reason == "waiting"));
    let [first, second] = begun.map(|course| course.map(String::as_str).collect::<Vec<&str>>());
    assert_eq!(first, [&["used", "frozen"], after].concat());
    assert_eq!(second, ["used"]);

    let healths = run.samples::<Health>("fused.health");
    let named = healths.iter().filter(|h| h.elements[0].reason() == "frozen");
    let named: Vec<f64> =
        named.map(|h| (h.header.stamp - stillpoint_testing::run::START) as f64 * 1e-9).collect();
    assert!(named[0] >= 3.3 && named[0] < 3.4 && named[named.len() - 1] < 5.0 + 1e-9, "{named:?}");

    let second = run.samples::<Track>("second.state");
    let fused = run.samples::<Track>("fused.state");
    let mut alone = 0;
    for own in second.iter().skip(FROZEN.start + 4).take(FROZEN.len() - 5) {
        for track in fused.iter().filter(|t| t.header.origin == own.header.origin) {
            let (track, own) = (track.first().unwrap(), own.first().unwrap());
            assert!(track.standing() != Standing::None);
            assert!((0..3).all(|i| (track.position[i] - own.position[i]).abs() < 1e-12), "{track:?}");
            alone += 1;
        }
    }
    assert!(alone >= 15, "{alone}");
}

#[test]
fn a_frozen_camera_before_a_head_at_rest_is_named_and_left_out_until_it_sees_again() {
    let (_, run) = at_rest();
    check(run, &["returning", "used"]);
}

#[test]
fn a_frozen_camera_before_a_moving_head_leaves_the_track_to_the_other() {
    let (truth, run) = seen("raise");
    // Its filter is behind at first.
    check(&run, &["returning", "disagrees", "returning", "used"]);
    assert!(truth[FROZEN.end] - truth[FROZEN.start] > 2.5e-3, "the head moves");
    let fused = run.samples::<Track>("fused.state");
    let height = |frame: usize| {
        let time = stillpoint_testing::run::START + frame as u64 * 100_000_000;
        fused.iter().find(|t| t.header.origin == time).unwrap().first().unwrap().position[2]
    };
    for frame in FROZEN.start + 4..FRAMES {
        let error = (height(frame) - height(FROZEN.start)) - (truth[frame] - truth[FROZEN.start]);
        assert!(error.abs() < 0.5e-3, "frame {frame}: {error} m");
    }
}

#[test]
fn the_same_image_again_has_the_same_pose_and_report_to_the_bit() {
    let (_, run) = at_rest();
    for topic in ["first_face.face", "first_face.diagnostics", "first_head.pose", "first_head.report"] {
        // Heads have another time and number each.
        let contents: Vec<&[u8]> =
            run.owned_samples(topic).map(|p| &p.bytes[stillpoint_samples::HEADER_SIZE..]).collect();
        assert_eq!(contents.len(), FRAMES, "{topic}");
        let is_same = |frame: usize| contents[frame] == contents[frame - 1];
        assert!((1..FRAMES).all(|f| is_same(f) == (FROZEN.start + 1..FROZEN.end).contains(&f)), "{topic}");
    }
}
