//! `track.centroid` on a bench.

use proptest::prelude::*;
use stillpoint_operator::files::MemoryFiles;
use stillpoint_samples::{CloudShape, Point, PointCloud, Pose, PoseElement};
use stillpoint_testing::Bench;

const TEXT: &str = "
stillpoint: 1
name: track
frames: { camera: { parent: couch, at: [1 m, 2 m, 3 m], rotation: [0 deg, 0 deg, 90 deg] } }
operators:
  feed: { use: feed.cloud, frame: camera }
  head: { use: track.centroid, inputs: { face: feed.out }, frame: couch, params: { shared_sd: 1 mm } }
";

fn bench(text: &str) -> Bench {
    Bench::new(text, "head", stillpoint_track::STAGES, &MemoryFiles::default()).unwrap()
}

fn feed(bench: &mut Bench, points: &[[f32; 3]]) -> Option<PoseElement> {
    let points: Vec<Point> = points.iter().map(|&xyz| Point { xyz }).collect();
    let shape = CloudShape { width: points.len() as u32, height: 1, reserved: 0, length: 0 };
    let left = bench.feed::<PointCloud>(0, &shape, &points, 0);
    assert_eq!(left.fault, None);
    left.outputs.first().map(|(_, p)| *p.pieces().view::<Pose>().unwrap().first().unwrap())
}

#[test]
fn the_centroid_is_given_in_the_frame_that_is_named() {
    let pose = feed(&mut bench(TEXT), &[[0.0, 0.0, 1.0], [0.2, 0.0, 1.0]]).unwrap();
    // A quarter turn about z takes the camera's x to the couch's y.
    let expected = [1.0, 2.1, 4.0];
    assert!((0..3).all(|i| (pose.position[i] - expected[i]).abs() < 1e-7), "{:?}", pose.position);
    let variance = |i: usize| pose.covariance[7 * i];
    assert!((variance(0) - 1e-6).abs() < 1e-12 && (variance(1) - 0.01 - 1e-6).abs() < 1e-7);
}

#[test]
fn without_a_frame_it_stays_in_that_of_the_face() {
    let text = TEXT.replace(", frame: couch, params", ", params");
    let pose = feed(&mut bench(&text), &[[0.0, 0.0, 1.0], [0.2, 0.0, 1.0]]).unwrap();
    assert!((0..3).all(|i| (pose.position[i] - [0.1, 0.0, 1.0][i]).abs() < 1e-7), "{:?}", pose.position);
}

#[test]
fn the_orientation_is_unknown() {
    let pose = feed(&mut bench(TEXT), &[[0.0, 0.0, 1.0], [0.2, 0.1, 1.0]]).unwrap();
    assert_eq!(pose.orientation, [1.0, 0.0, 0.0, 0.0]);
    for i in 3..6 {
        assert_eq!(pose.covariance[7 * i], f64::INFINITY);
    }
    let symmetric = (0..6).all(|i| (0..6).all(|j| pose.covariance[6 * i + j] == pose.covariance[6 * j + i]));
    assert!(symmetric);
}

#[test]
fn a_face_without_two_points_has_no_position() {
    for points in [&[][..], &[[1.0, 2.0, 3.0]], &[[f32::NAN; 3], [1.0, 2.0, 3.0]]] {
        assert_eq!(feed(&mut bench(TEXT), points), None);
    }
}

fn any_coordinate() -> impl Strategy<Value = f32> {
    prop_oneof![4 => (-2000..2000).prop_map(|mm| mm as f32 * 1e-3), 1 => Just(f32::NAN), 1 => Just(f32::INFINITY), 1 => Just(f32::MAX)]
}

proptest! {
    #[test]
    fn no_face_stops_it_and_buffers_do_not_matter(
        points in prop::collection::vec([any_coordinate(), any_coordinate(), any_coordinate()], 0..50),
    ) {
        let points: Vec<Point> = points.into_iter().map(|xyz| Point { xyz }).collect();
        let shape = CloudShape { width: points.len() as u32, height: 1, reserved: 0, length: 0 };
        let left = |padding| bench(TEXT).padded(padding).feed::<PointCloud>(0, &shape, &points, 0);
        prop_assert!(left(0).fault.is_none());
        prop_assert!(left(0).bytes() == left(9).bytes());
    }
}
