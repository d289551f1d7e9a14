//! `sink.null` on a bench.

use stillpoint_operator::files::MemoryFiles;
use stillpoint_samples::{CloudShape, Diagnostics, Point, PointCloud, Pose, PoseElement};
use stillpoint_testing::Bench;

const TEXT: &str = "
stillpoint: 1
name: sink
frames: { camera: { parent: couch, at: [0 m, 0 m, 1 m] } }
operators:
  clouds: { use: feed.cloud, frame: camera }
  poses: { use: feed.pose, frame: camera }
  end: { use: sink.null, inputs: { cloud: clouds.out, pose: poses.out } }
";

#[test]
fn it_counts_what_it_takes_by_input() {
    let mut bench = Bench::new(TEXT, "end", stillpoint_pipeline::STAGES, &MemoryFiles::default()).unwrap();
    let point = Point { xyz: [f32::NAN; 3] };
    let shape = CloudShape { width: 1, height: 1, reserved: 0, length: 1 };
    let pose = PoseElement { position: [f64::NAN; 3], orientation: [0.0; 4], covariance: [0.0; 36] };
    bench.feed::<PointCloud>(0, &shape, &[point], 0);
    bench.feed::<Pose>(2, &(), &[pose], 0);
    let left = bench.feed::<PointCloud>(0, &shape, &[point], 0);
    let counts = left.outputs[0].1.pieces().view::<Diagnostics>().unwrap();
    let counts: Vec<(&str, f64)> = counts.elements.iter().map(|m| (m.name(), m.value)).collect();
    assert_eq!(counts[..3], [("cloud", 2.0), ("image", 0.0), ("pose", 1.0)]);
}
