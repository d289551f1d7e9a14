//! Steps of the network and of the controllers take no memory from the heap.

use std::collections::BTreeMap;

use stillpoint_control::features::{Features, Learned};
use stillpoint_control::operators::{ControlLqg, ControlMrac, ControlPi, ControlTarget};
use stillpoint_operator::Outputs;
use stillpoint_operator::Setup;
use stillpoint_operator::activation::{Activation, ActivationInput, Consumed, RandomKey};
use stillpoint_operator::files::MemoryFiles;
use stillpoint_operator::{Operator, Registry};
use stillpoint_samples::{
    Actuation, ActuationElement, ActuationState, AlignedBytes, Cause, Header, Pieces, Sample, SampleKind,
    Standing, Target, TargetElement, TargetStatus, Track, TrackElement,
};
use stillpoint_testing::pipeline::config::check;
use stillpoint_testing::pipeline::drafts::{Buffer, Draft, DraftBuffers, Lender};
use stillpoint_testing::pipeline::graph::Graph;
use zerocopy::IntoBytes;

use super::network::predictor;

const TEXT: &str = "
stillpoint: 1
name: quiet
frames: { camera: { parent: couch, at: [0 m, 0 m, 1 m] } }
operators:
  feed: { use: feed.track, frame: couch }
  target: { use: control.target, every: 10 ms, inputs: { state: feed.out }, params: { moves: [{ at: 100 ms, over: 1 s, z: 5 mm }] } }
  pi: { use: control.pi, every: 10 ms, inputs: { state: feed.out, target: target.reference } }
  lqg: { use: control.lqg, every: 10 ms, inputs: { state: feed.out, target: target.reference } }
  mrac: { use: control.mrac, every: 10 ms, inputs: { state: feed.out, target: target.reference } }
  learned: { use: control.mrac, every: 10 ms, inputs: { state: feed.out, target: target.reference }, params: { features: lstm, model: net } }
  squeezing: { use: control.pi, every: 10 ms, inputs: { state: feed.out, target: target.reference }, params: { plant: { channels: [z, roll] } } }
  answering: { use: control.pi, every: 10 ms, inputs: { state: feed.out, target: target.reference }, params: { plant: { motion: learned, outlet: 0.54 } } }
";

/// Lends what was made before, as shared memory does.
struct Stock(Vec<Option<Buffer>>);

impl Lender for Stock {
    fn loan(&mut self, port: usize, _: usize) -> Option<Buffer> {
        self.0[port].take()
    }
}

/// Steps an operator every 10 ms over `steps` estimates, and counts what its steps take from the heap.
fn allocations<T: Operator>(graph: &Graph, files: &MemoryFiles, name: &str, steps: u64) -> u64 {
    let node = &graph.operators[graph.operator(name).unwrap()];
    let params = node.params.value.downcast_ref::<T::Params>().unwrap().clone();
    let capacities = T::capacities(&params);
    let frames = graph.frames.clone();
    let setup = Setup {
        operator: name,
        every: Some(10_000_000),
        connected: &[true, true, name == "squeezing"],
        input_frames: &[],
        output_frames: &[],
        frames: &frames,
        files,
        outside: Default::default(),
    };
    let kinds: Vec<(&'static SampleKind, usize)> =
        T::KIND.outputs.iter().map(|o| o.sample).zip(capacities).collect();
    let mut operator = T::new(params, &setup).unwrap();
    let mut drafts: Vec<Draft> = Vec::with_capacity(8);
    let mut count = 0;
    for k in 0..steps {
        let time = 1_000_000_000 + k * 10_000_000;
        let wave = libm::sin(0.01 * k as f64);
        let mut track = TrackElement {
            position: [0.0, 0.0, 0.1 + 0.004 * wave],
            orientation: [1.0, 0.0, 0.0, 0.0],
            channels: 0x3f,
            accepted: k,
            standing: Standing::Measured as u32,
            ..TrackElement::NONE
        };
        // No estimate, no number, a target out of all proportion: nothing of it may allocate.
        match k % 100 {
            30 => track.standing = Standing::None as u32,
            60 => track.position[2] = f64::NAN,
            _ => {}
        }
        let far = if k % 100 == 80 { 10.0 } else { 0.0 };
        let target = TargetElement {
            position: [f64::NAN, f64::NAN, 0.1 + far],
            angles: [0.0; 3],
            channels: 0b01_1100,
            status: TargetStatus::Held as u32,
            ..TargetElement::NONE
        };
        let state = sample::<Track>(&track, time);
        let target = sample::<Target>(&target, time);
        let consumed = |pieces| ActivationInput {
            sample: Some(Consumed { pieces, held: false }),
            ..ActivationInput::default()
        };
        let pressures = ActuationElement {
            pressure: [7e3 + 1e3 * wave; 8],
            state: ActuationState::Armed as u32,
            ..ActuationElement::default()
        };
        let pressures = sample::<Actuation>(&pressures, time);
        let mut inputs = [ActivationInput::default(); 3];
        inputs[0] = consumed(Pieces::split(Track::KIND, &state).unwrap());
        if T::KIND.inputs[1].sample.name == "Target" {
            inputs[1] = consumed(Pieces::split(Target::KIND, &target).unwrap());
        }
        if name == "squeezing" {
            inputs[2] = consumed(Pieces::split(Actuation::KIND, &pressures).unwrap());
        }
        let activation = Activation {
            index: k,
            time,
            nominal: time,
            tick: k,
            origin: time,
            cause: Cause::Timer,
            port: 0,
            inputs: &inputs[..T::KIND.inputs.len()],
            key: RandomKey::default(),
        };
        drafts.clear();
        let mut stock = Stock(kinds.iter().map(|(kind, n)| Some(Buffer::heap(kind, *n))).collect());
        let counted = allocation_counter::measure(|| {
            let mut buffers = DraftBuffers::new(&kinds, &mut stock, &mut drafts);
            let mut outputs = Outputs::new(&kinds, 0, &mut buffers);
            operator.step(&activation, &mut outputs).unwrap();
        });
        assert_eq!(drafts.len(), 2, "{name} at {k}");
        count += counted.count_total;
    }
    count
}

fn sample<S: Sample<Body = ()>>(element: &S::Element, origin: u64) -> AlignedBytes {
    let head = Header { stamp: origin, origin, sequence: 0, incarnation: 0, count: 1 };
    AlignedBytes::copy_of(&[head.as_bytes(), element.as_bytes()].concat())
}

#[test]
fn steps_of_targets_and_controllers_allocate_nothing() {
    let registry = Registry::new(&[stillpoint_testing::feed::STAGES, stillpoint_control::STAGES]);
    let mut files = MemoryFiles::default();
    files.files.insert("net".into(), predictor().to_safetensors(&BTreeMap::new()));
    let graph = check(TEXT, "quiet.yaml", &[], &registry, &files).unwrap();
    assert_eq!(allocations::<ControlTarget>(&graph, &files, "target", 300), 0);
    assert_eq!(allocations::<ControlPi>(&graph, &files, "pi", 300), 0);
    assert_eq!(allocations::<ControlPi>(&graph, &files, "squeezing", 300), 0);
    assert_eq!(allocations::<ControlPi>(&graph, &files, "answering", 1200), 0);
    assert_eq!(allocations::<ControlLqg>(&graph, &files, "lqg", 300), 0);
    assert_eq!(allocations::<ControlMrac>(&graph, &files, "mrac", 300), 0);
    assert_eq!(allocations::<ControlMrac>(&graph, &files, "learned", 300), 0);
}

#[test]
fn a_step_of_the_network_allocates_nothing() {
    let predictor = predictor();
    let mut memory = predictor.network().memory();
    let mut features = Features::Learned(Box::new(Learned::new(predictor.clone(), predictor.scale())));
    let (mut y, mut phi) = ([0.0; 3], [0.0; 7]);
    let counted = allocation_counter::measure(|| {
        for k in 0..20 {
            predictor.network().step(&[0.1 * f64::from(k); 9], &mut memory);
            predictor.network().output(&memory, &mut y);
            features.look(&[0.1; 3], 0.1, &mut phi);
            features.acted(&[0.05; 3]);
        }
    });
    assert_eq!(counted.count_total, 0);
    assert!(y.iter().all(|v| v.is_finite() && *v != 0.0) && phi[0] != 0.0);
}
