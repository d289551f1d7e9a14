//! A step of the filter or of the fusion takes no memory from the heap.

use stillpoint_estimate::operators::{EstimateFuse, EstimateKalman};
use stillpoint_pipeline::activation::{Activation, Brought, Consumed, RandomKey};
use stillpoint_pipeline::files::KeptFiles;
use stillpoint_pipeline::graph::Graph;
use stillpoint_pipeline::operator::{Operator, Registry};
use stillpoint_pipeline::outputs::{Buffer, Draft, Lender, Outputs};
use stillpoint_pipeline::params::CheckedParams;
use stillpoint_pipeline::setup::Setup;
use stillpoint_pipeline::spec::check;
use stillpoint_samples::{
    AlignedBytes, Cause, Head, Pieces, Pose, PoseElement, Sample, SampleKind, Track, TrackElement,
};
use zerocopy::IntoBytes;

use super::random::Random;

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

/// Lends what was made before, as shared memory does.
struct Stock(Vec<Option<Buffer>>);

impl Lender for Stock {
    fn loan(&mut self, port: usize, _: usize) -> Option<Buffer> {
        self.0[port].take()
    }
}

/// An operator with all that a step of it touches.
struct Quiet<T> {
    operator: T,
    kinds: Vec<(&'static SampleKind, usize)>,
    stock: Stock,
    drafts: Vec<Draft>,
    steps: u64,
    allocations: u64,
}

impl<T: Operator> Quiet<T> {
    fn new(graph: &Graph, name: &str) -> Self {
        let node = &graph.operators[graph.operator(name).unwrap()];
        let CheckedParams { value, .. } = &node.params;
        let params = value.downcast_ref::<T::Params>().unwrap().clone();
        let capacities = T::capacities(&params);
        let frames = graph.frames.clone();
        let files = KeptFiles::default();
        let setup = Setup {
            operator: name,
            every: None,
            connected: &[true, true],
            input_frames: &[],
            output_frames: &[],
            frames: &frames,
            files: &files,
            outside: Default::default(),
        };
        let kinds: Vec<_> = T::KIND.outputs.iter().map(|o| o.sample).zip(capacities).collect();
        Self {
            operator: T::new(params, &setup).unwrap(),
            stock: Stock(kinds.iter().map(|_| None).collect()),
            drafts: Vec::with_capacity(8),
            kinds,
            steps: 0,
            allocations: 0,
        }
    }

    fn step(&mut self, cause: Cause, port: usize, time: u64, sample: Option<Pieces<'_>>) {
        self.drafts.clear();
        for (slot, (kind, capacity)) in self.stock.0.iter_mut().zip(&self.kinds) {
            *slot = Some(Buffer::heap(kind, *capacity));
        }
        let mut inputs = [Brought::default(); 2];
        inputs[port].sample = sample.map(|pieces| Consumed { pieces, held: false });
        let activation = Activation {
            index: self.steps,
            time,
            nominal: time,
            tick: 0,
            origin: time,
            cause,
            port,
            inputs: &inputs,
            key: RandomKey::default(),
        };
        let (operator, stock, drafts, kinds) =
            (&mut self.operator, &mut self.stock, &mut self.drafts, &self.kinds);
        let counted = allocation_counter::measure(|| {
            let mut outputs = Outputs::new(kinds, 0, stock, drafts);
            operator.step(&activation, &mut outputs).unwrap();
        });
        self.allocations += counted.count_total;
        self.steps += 1;
    }

    fn sent<S: Sample<Body = ()>>(&self, port: usize) -> Option<S::Element> {
        let draft = self.drafts.iter().find(|d| d.port == port)?;
        draft.buffer.pieces().view::<S>().ok()?.first().copied()
    }
}

fn sample<S: Sample<Body = ()>>(element: &S::Element, origin: u64) -> AlignedBytes {
    let head = Head { stamp: origin, origin, sequence: 0, incarnation: 0, count: 1 };
    AlignedBytes::copy_of(&[head.as_bytes(), element.as_bytes()].concat())
}

#[test]
fn a_step_of_filter_and_fusion_allocates_nothing() {
    let registry = Registry::new(&[stillpoint_testing::feed::STAGES, stillpoint_estimate::STAGES]);
    let graph = check(TEXT, "quiet.yaml", &[], &registry, &KeptFiles::default()).unwrap();
    let mut filters = ["first", "second"].map(|name| Quiet::<EstimateKalman>::new(&graph, name));
    let mut fuse = Quiet::<EstimateFuse>::new(&graph, "fused");
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
            let origin = if k % 50 == 10 { 1_000_000_000 } else { time };
            let bytes = sample::<Pose>(&pose, origin);
            filter.step(Cause::Input, 0, time, Some(Pieces::split(Pose::KIND, &bytes).unwrap()));
            let Some(track) = filter.sent::<Track>(0) else { continue };
            let bytes = sample::<Track>(&track, time);
            fuse.step(
                Cause::Input,
                side,
                time + 1_000_000,
                Some(Pieces::split(Track::KIND, &bytes).unwrap()),
            );
            fused += u64::from(fuse.sent::<Track>(0).is_some_and(|t: TrackElement| t.standing == 1));
        }
        fuse.step(Cause::Timer, 0, 1_000_000_000 + k * 33_000_000 + 20_000_000, None);
    }
    assert!(fused > 300, "{fused}");
    for (name, steps, allocations) in [
        ("first", filters[0].steps, filters[0].allocations),
        ("second", filters[1].steps, filters[1].allocations),
        ("fused", fuse.steps, fuse.allocations),
    ] {
        assert!(steps >= 200);
        assert_eq!(allocations, 0, "{name}: {allocations} in {steps} steps");
    }
    // The counter counts: a test that cannot fail proves nothing.
    assert!(allocation_counter::measure(|| drop(std::hint::black_box(vec![1_u8; 64]))).count_total > 0);
}
