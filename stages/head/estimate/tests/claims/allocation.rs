//! A step of the filter or of the fusion takes no memory from the heap.

use stillpoint_operator::files::MemoryFiles;
use stillpoint_samples::{Header, Pieces, Pose, PoseElement, Sample, Track, TrackElement};
use stillpoint_testing::Quiet;
use stillpoint_testing::sample::bytes_of;

use stillpoint_mechanics::random::Random;

const TEXT: &str = "
stillpoint: 1
name: quiet
frames: { camera: { parent: couch, at: [0 m, 0 m, 1 m] } }
operators:
  a: { use: feed.pose, frame: couch }
  b: { use: feed.pose, frame: couch }
  first: { use: estimate.kalman, inputs: { measurement: a.out }, params: { follow: pose } }
  second: { use: estimate.kalman, inputs: { measurement: b.out }, params: { follow: pose } }
  fused: { use: estimate.fuse, every: 20 ms, inputs: { first: first.state, second: second.state }, params: { follow: pose } }
";

/// An operator, and what its steps took from the heap.
struct Watched {
    operator: Quiet,
    allocations: u64,
}

impl Watched {
    fn new(name: &str) -> Self {
        let operator = Quiet::new(TEXT, name, stillpoint_estimate::STAGES, &MemoryFiles::default()).unwrap();
        Self { operator, allocations: 0 }
    }

    fn feed<S: Sample<Body = ()>>(&mut self, port: usize, time: u64, element: &S::Element, origin: u64) {
        let head = Header { stamp: origin, origin, sequence: 0, incarnation: 0, count: 1 };
        let bytes = bytes_of::<S>(&head, &(), std::slice::from_ref(element));
        let pieces = Pieces::split(S::KIND, &bytes).unwrap();
        self.allocations += self.operator.feed(port, time, pieces, count).unwrap();
    }

    fn tick(&mut self, time: u64) {
        self.allocations += self.operator.tick(time, count).unwrap();
    }

    fn track(&self) -> Option<TrackElement> {
        self.operator.sent::<Track>(0)?.first().copied()
    }
}

/// Allocations of a step.
fn count(step: &mut dyn FnMut()) -> u64 {
    allocation_counter::measure(step).count_total
}

#[test]
fn a_step_of_filter_and_fusion_allocates_nothing() {
    let mut filters = ["first", "second"].map(Watched::new);
    let mut fuse = Watched::new("fused");
    let mut random = Random::new(2);
    let mut fused = 0;
    for k in 1..=300_u64 {
        for (side, filter) in filters.iter_mut().enumerate() {
            let time = 1_000_000_000 + k * 33_000_000 + side as u64 * 12_000_000;
            let mut covariance = [0.0; 36];
            (0..6).for_each(|i| covariance[7 * i] = 1e-6);
            let mut pose = PoseElement { position: [0.0; 3], orientation: [1.0, 0.0, 0.0, 0.0], covariance };
            pose.position = pose.position.map(|x| x + 1e-3 * random.normal());
            // Outliers, late frames, frames without numbers, a sensor that stops: nothing of it may allocate.
            match k % 50 {
                20 => pose.position[0] += 1.0,
                30 => pose.position[1] = f64::NAN,
                40.. if side == 1 => continue,
                _ => {}
            }
            let origin = match k % 50 {
                10 => 1_000_000_000,
                15 => time + 3_600_000_000_000,
                _ => time,
            };
            filter.feed::<Pose>(0, time, &pose, origin);
            let Some(track) = filter.track() else { continue };
            fuse.feed::<Track>(side, time + 1_000_000, &track, time);
            fused += u64::from(fuse.track().is_some_and(|t| t.standing == 1));
        }
        fuse.tick(1_000_000_000 + k * 33_000_000 + 20_000_000);
    }
    assert!(fused > 300, "{fused}");
    let [first, second] = &filters;
    for (name, watched) in [("first", first), ("second", second), ("fused", &fuse)] {
        assert!(watched.operator.steps() >= 200);
        assert_eq!(watched.allocations, 0, "{name}, in {} steps", watched.operator.steps());
    }
    // The counter counts: a test that cannot fail proves nothing.
    assert!(count(&mut || drop(std::hint::black_box(vec![1_u8; 64]))) > 0);
}
