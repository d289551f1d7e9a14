//! `segment.face` on a bench.

#![allow(clippy::unwrap_used, clippy::panic)]

use proptest::prelude::*;
use stillpoint_operator::files::MemoryFiles;
use stillpoint_samples::{
    CloudShape, ClusterEdge, ClusterTable, Diagnostics, Hull, Plane, Point, PointCloud, Rejection, Sample,
    View,
};
use stillpoint_testing::Bench;
use stillpoint_testing::bench::Left;

const FACE: usize = 0;
const DIAGNOSTICS: usize = 1;
const PLANE: usize = 2;
const HULL: usize = 3;
const CLUSTERS: usize = 4;
const REJECTION: usize = 5;

const TEXT: &str = "
stillpoint: 1
name: segment
frames: { camera: { parent: couch, at: [0 mm, 0 mm, 1 m] } }
operators:
  feed: { use: feed.cloud, frame: camera }
  face: { use: segment.face, inputs: { cloud: feed.out }, params: { rule: largest, max_points: 2000, iterations: 50 } }
";

fn bench() -> Bench {
    Bench::new(TEXT, "face", stillpoint_segment::STAGES, &MemoryFiles::default()).unwrap()
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

fn ports(left: &Left) -> Vec<usize> {
    left.outputs.iter().map(|(port, _)| *port).collect()
}

fn view<S: Sample>(left: &Left, port: usize) -> View<'_, S> {
    left.outputs.iter().find(|(p, _)| *p == port).unwrap().1.pieces().view::<S>().unwrap()
}

fn metrics(left: &Left) -> Vec<(String, f64)> {
    let (_, owned) = left.outputs.iter().find(|(port, _)| *port == 1).unwrap();
    let view = owned.pieces().view::<Diagnostics>().unwrap();
    view.elements.iter().map(|m| (m.name().to_string(), m.value)).collect()
}

fn metric(left: &Left, name: &str) -> f64 {
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
    // The plane and its hull were found all the same, and the table has no rows.
    assert_eq!(ports(&left), [REJECTION, PLANE, HULL, CLUSTERS, DIAGNOSTICS]);
    assert_eq!((metric(&left, "rejection"), metric(&left, "sent_points")), (3.0, 0.0));
    let rejection = view::<Rejection>(&left, REJECTION).elements[0];
    assert_eq!((rejection.code, rejection.found, rejection.needed), (3, 0.0, 100.0));
    assert_eq!(rejection.reason(), "0 voxels are over the plane and no cluster of them has 100");

    let left = bench().feed::<PointCloud>(0, &shape(&[]), &[], 0);
    assert_eq!(ports(&left), [REJECTION, DIAGNOSTICS]);
    assert_eq!(metric(&left, "rejection"), 1.0);
}

#[test]
fn plane_hull_and_clusters_are_sent_beside_the_face() {
    let cloud = block_on_a_table();
    let mut bench = bench();
    let grid = CloudShape { width: 160, height: 120, ..shape(&cloud) };
    let left = bench.feed::<PointCloud>(0, &grid, &cloud, 0);
    assert_eq!(ports(&left), [FACE, PLANE, HULL, CLUSTERS, DIAGNOSTICS]);
    let plane = view::<Plane>(&left, PLANE).elements[0];
    assert!((plane.offset - 1.0).abs() < 1e-6 && plane.rms < 1e-6 && plane.kept == 0);
    let hull = view::<Hull>(&left, HULL);
    assert_eq!((hull.elements.len(), hull.body.found), (4, 4));
    assert!((hull.body.area - 0.795 * 0.595).abs() < 1e-3, "{}", hull.body.area);
    let table = view::<ClusterTable>(&left, CLUSTERS);
    let [block] = table.elements else { panic!("{} clusters", table.elements.len()) };
    assert_eq!((block.chosen, block.touches, block.voxels), (1, 0, block.face_voxels));
    assert!((block.height_max - 0.2).abs() < 1e-5 && block.centroid[2] > 0.79);
    // The plane of one frame is where the next one's search begins; the same frame again is not searched.
    let mut next = cloud.clone();
    next[0].xyz[0] += 1e-4;
    for (cloud, kept) in [(&cloud, 0), (&next, 1), (&next, 1)] {
        let left = bench.feed::<PointCloud>(0, &grid, cloud, 0);
        assert_eq!(view::<Plane>(&left, PLANE).elements[0].kept, kept);
    }
}

#[test]
fn outliers_are_removed_and_voxels_smoothed_where_it_is_asked_for() {
    let text =
        TEXT.replace("rule: largest", "rule: largest, outliers: remove, smoothing: moving_least_squares");
    let mut bench = Bench::new(&text, "face", stillpoint_segment::STAGES, &MemoryFiles::default()).unwrap();
    let mut cloud = block_on_a_table();
    // One that stands apart, in the prism over the table.
    cloud.push(Point { xyz: [0.2, 0.2, 0.75] });
    let left = bench.feed::<PointCloud>(0, &shape(&cloud), &cloud, 0);
    assert_eq!(left.fault, None);
    let of = |left: &Left, name| metric(left, name);
    assert_eq!(of(&left, "rejection"), 0.0);
    let plain = self::bench().feed::<PointCloud>(0, &shape(&cloud), &cloud, 0);
    assert!(of(&left, "voxels") < of(&plain, "voxels"));
    assert_eq!(of(&left, "outlier_voxels"), of(&plain, "voxels") - of(&left, "voxels"));
    assert_eq!((of(&plain, "outlier_voxels"), of(&plain, "clusters_cut")), (0.0, 0.0));
    assert_eq!(of(&plain, "points_in_range"), cloud.len() as f64);
    assert!((of(&left, "plane_offset_m") - 1.0).abs() < 1e-3);
}

#[test]
fn a_cluster_says_where_it_may_not_be_whole() {
    let mut cloud = block_on_a_table();
    for (i, point) in cloud.iter_mut().enumerate() {
        // Moved to the edge of the image, and up to the greatest height.
        let (row, column) = (i / 160, i % 160);
        point.xyz[2] = if row < 20 && (60..80).contains(&column) { 0.6405 } else { 1.0 };
    }
    let grid = CloudShape { width: 160, height: 120, ..shape(&cloud) };
    let left = bench().feed::<PointCloud>(0, &grid, &cloud, 0);
    let touches = view::<ClusterTable>(&left, CLUSTERS).elements[0].touches;
    assert_eq!(touches, ClusterEdge::AT_IMAGE_EDGE | ClusterEdge::AT_CEILING | ClusterEdge::AT_HULL_EDGE);
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
        6 => (-1500..1500).prop_map(|mm| mm as f32 * 1e-3),
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
