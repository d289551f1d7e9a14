//! `segment.face` on a bench.

#![allow(clippy::unwrap_used, clippy::panic)]

use proptest::prelude::*;
use stillpoint_pipeline::files::KeptFiles;
use stillpoint_samples::{CloudShape, Diagnostics, Point, PointCloud};
use stillpoint_testing::Bench;

const TEXT: &str = "
stillpoint: 1
name: segment
frames: { camera: { parent: couch, at: [0 mm, 0 mm, 1 m] } }
operators:
  feed: { use: feed.cloud, frame: camera }
  face: { use: segment.face, inputs: { cloud: feed.out }, params: { max_points: 2000, iterations: 50 } }
";

fn bench() -> Bench {
    Bench::new(TEXT, "face", stillpoint_segment::STAGES, &KeptFiles::default()).unwrap()
}

/// A table 1 m below the camera, and a block 0.2 m high on it, 0.1 m wide and long.
fn block_on_a_table() -> Vec<Point> {
    let mut points = Vec::new();
    for row in 0..120 {
        for column in 0..160 {
            let (x, y) = (column as f32 * 5e-3 - 0.4, row as f32 * 5e-3 - 0.3);
            let z = if x.abs() < 0.05 && y.abs() < 0.05 { 0.8 } else { 1.0 };
            points.push(Point { xyz: [x, y, z] });
        }
    }
    points
}

fn shape(points: &[Point]) -> CloudShape {
    CloudShape { width: points.len() as u32, height: 1, reserved: 0, length: points.len() as u32 }
}

fn metrics(left: &stillpoint_testing::bench::Left) -> Vec<(String, f64)> {
    let (_, parcel) = left.outputs.iter().find(|(port, _)| *port == 1).unwrap();
    let view = parcel.pieces().view::<Diagnostics>().unwrap();
    view.elements.iter().map(|m| (m.name().to_string(), m.value)).collect()
}

fn metric(left: &stillpoint_testing::bench::Left, name: &str) -> f64 {
    metrics(left).into_iter().find(|(n, _)| n == name).unwrap().1
}

#[test]
fn what_stands_on_the_plane_is_the_face() {
    let cloud = block_on_a_table();
    let left = bench().feed::<PointCloud>(0, &shape(&cloud), &cloud, 0);
    assert_eq!(left.fault, None);
    let face = left.outputs[0].1.pieces().view::<PointCloud>().unwrap();
    assert_eq!((face.body.width, face.body.height), (face.elements.len() as u32, 1));
    assert!(face.elements.len() > 350 && face.elements.iter().all(|p| p.xyz[2] == 0.8));
    assert_eq!(metric(&left, "rejection"), 0.0);
    assert!((metric(&left, "plane_offset_m") - 1.0).abs() < 1e-3);
    assert_eq!(metric(&left, "face_points"), face.elements.len() as f64);
}

#[test]
fn a_frame_without_a_face_says_why_and_sends_none() {
    let table: Vec<Point> =
        block_on_a_table().into_iter().map(|p| Point { xyz: [p.xyz[0], p.xyz[1], 1.0] }).collect();
    let left = bench().feed::<PointCloud>(0, &shape(&table), &table, 0);
    assert_eq!(left.outputs.len(), 1);
    assert_eq!((metric(&left, "rejection"), metric(&left, "sent_points")), (3.0, 0.0));
    let left = bench().feed::<PointCloud>(0, &shape(&[]), &[], 0);
    assert_eq!((metric(&left, "rejection"), metric(&left, "rejected_with_voxels")), (1.0, 0.0));
}

#[test]
fn a_face_of_too_many_points_is_thinned_evenly() {
    // 60,000 points of the block's top in place of 400.
    let mut cloud = block_on_a_table();
    for i in 0..60_000 {
        let (x, y) = ((i % 300) as f32 / 3000.0 - 0.05, (i / 300) as f32 / 2000.0 - 0.05);
        cloud.push(Point { xyz: [x, y, 0.8] });
    }
    let left = bench().feed::<PointCloud>(0, &shape(&cloud), &cloud, 0);
    let face = left.outputs[0].1.pieces().view::<PointCloud>().unwrap();
    assert_eq!((face.elements.len(), metric(&left, "sent_points")), (2000, 2000.0));
    assert!(metric(&left, "face_points") > 50_000.0);
    let mean = |axis: usize| face.elements.iter().map(|p| f64::from(p.xyz[axis])).sum::<f64>() / 2000.0;
    assert!(mean(0).abs() < 2e-3 && mean(1).abs() < 2e-3, "{} {}", mean(0), mean(1));
}

#[test]
fn the_same_frames_give_the_same_bytes_wherever_the_buffers_lie() {
    let cloud = block_on_a_table();
    let bytes = |padding| {
        let mut bench = bench().padded(padding);
        (0..3)
            .flat_map(|_| bench.feed::<PointCloud>(0, &shape(&cloud), &cloud, 0).bytes())
            .collect::<Vec<u8>>()
    };
    assert!(bytes(0) == bytes(0));
    assert!(bytes(0) == bytes(17));
}

fn any_coordinate() -> impl Strategy<Value = f32> {
    prop_oneof![
        6 => -1.5f32..1.5,
        1 => Just(f32::NAN),
        1 => Just(f32::INFINITY),
        1 => Just(f32::MAX),
        1 => Just(-f32::MAX),
        1 => Just(f32::MIN_POSITIVE),
    ]
}

proptest! {
    #[test]
    fn no_cloud_stops_the_operator(
        clouds in prop::collection::vec(prop::collection::vec([any_coordinate(), any_coordinate(), any_coordinate()], 0..400), 1..3),
    ) {
        let mut bench = bench();
        for cloud in clouds {
            let points: Vec<Point> = cloud.into_iter().map(|xyz| Point { xyz }).collect();
            let left = bench.feed::<PointCloud>(0, &shape(&points), &points, 0);
            prop_assert!(!left.panicked && left.fault.is_none(), "{:?}", left.fault);
        }
    }
}
