//! A step of valves or gate takes no memory from the heap.

use stillpoint_actuate::operators::{ActuateValves, GateBeam};
use stillpoint_operator::Operator;
use stillpoint_operator::Outputs;
use stillpoint_operator::Setup;
use stillpoint_operator::activation::{Activation, ActivationInput, Consumed, RandomKey};
use stillpoint_samples::{
    Actuation, ActuationElement, AlignedBytes, Cause, ConsoleCommand, Duties, Gate, Header, Pieces,
    PlanRequest, PlanRequestElement, PlanStanding, PlanUpdate, PlanUpdateBody, PoseReport, Sample,
    SampleKind, Target, Track, Verb,
};
use stillpoint_testing::pipeline::config::check;
use stillpoint_testing::pipeline::drafts::{Buffer, Draft, DraftBuffers, Lender};
use stillpoint_testing::pipeline::graph::Graph;
use zerocopy::IntoBytes;

use super::script::{command, duties, report, target, track};
use super::whole::{Said, files, registry, text};

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
    allocations: u64,
}

impl<T: Operator> Quiet<T> {
    fn new(graph: &Graph, name: &str) -> Self {
        let node = &graph.operators[graph.operator(name).unwrap()];
        let params = node.params.value.downcast_ref::<T::Params>().unwrap().clone();
        let capacities = T::capacities(&params);
        let (frames, files) = (graph.frames.clone(), files());
        let couch: Vec<_> = node.inputs.iter().map(|i| i.frame.clone()).collect();
        let setup = Setup {
            operator: name,
            every: node.every,
            connected: &[true; 8],
            input_frames: &couch,
            output_frames: &[],
            frames: &frames,
            files: &files,
            outside: Default::default(),
        };
        let kinds: Vec<_> = T::KIND.outputs.iter().map(|o| o.sample).zip(capacities).collect();
        Self {
            operator: T::new(params, &setup).unwrap(),
            stock: Stock(Vec::new()),
            drafts: Vec::with_capacity(8),
            kinds,
            allocations: 0,
        }
    }

    fn step(&mut self, index: u64, time: u64, samples: &[(usize, Pieces<'_>)]) {
        self.drafts.clear();
        self.stock.0 = self.kinds.iter().map(|(kind, n)| Some(Buffer::heap(kind, *n))).collect();
        let mut inputs = [ActivationInput::default(); 8];
        for (port, pieces) in samples {
            inputs[*port].sample = Some(Consumed { pieces: *pieces, held: false });
        }
        let key = RandomKey::default();
        let activation = Activation {
            index,
            time,
            nominal: time,
            tick: index,
            origin: time,
            cause: Cause::Timer,
            port: 0,
            inputs: &inputs,
            key,
        };
        let (operator, stock, drafts, kinds) =
            (&mut self.operator, &mut self.stock, &mut self.drafts, &self.kinds);
        let counted = allocation_counter::measure(|| {
            let mut buffers = DraftBuffers::new(kinds, stock, drafts);
            let mut outputs = Outputs::new(kinds, 0, &mut buffers);
            operator.step(&activation, &mut outputs).unwrap();
        });
        self.allocations += counted.count_total;
    }

    fn sent<S: Sample<Body = ()>>(&self, port: usize) -> S::Element {
        let draft = self.drafts.iter().find(|d| d.port == port).unwrap();
        *draft.buffer.pieces().view::<S>().unwrap().first().unwrap()
    }
}

fn sample<S: Sample<Body = ()>>(element: &S::Element, time: u64) -> AlignedBytes {
    let head = Header { stamp: time, origin: time, sequence: 0, incarnation: 0, count: 1 };
    AlignedBytes::copy_of(&[head.as_bytes(), element.as_bytes()].concat())
}

fn pieces<S: Sample>(bytes: &AlignedBytes) -> Pieces<'_> {
    Pieces::split(S::KIND, bytes).unwrap()
}

/// A request for the planned set-up.
const REQUEST: PlanRequestElement = PlanRequestElement {
    position: [0.0; 3],
    orientation: [1.0, 0.0, 0.0, 0.0],
    case_hash: [0; 4],
    beams: 5,
    budget: 8,
};

#[test]
fn a_step_of_valves_and_gate_allocates_nothing() {
    let graph = check(&text(&Said::default()), "quiet.yaml", &[], &registry(), &files()).unwrap();
    let mut valves = Quiet::<ActuateValves>::new(&graph, "valves");
    let mut gate = Quiet::<GateBeam>::new(&graph, "gate");
    let (mut states, mut beams) = ([0; 5], 0);
    for k in 0..600_u64 {
        let time = 1_000_000_000 + k * 10_000_000;
        let mut pose = track(k);
        let mut order = duties(0.1 + 0.01 * (k % 70) as f64);
        // Faults of all kinds, and people that act: nothing of it may allocate.
        match k {
            200..240 => pose.accepted = 199,
            300 => pose.position[2] = f64::NAN,
            400 => order.duty[1] = f64::INFINITY,
            _ => {}
        }
        let verb = match k {
            5 => (3, Verb::Arm),
            320 | 420 => (5, Verb::Resume),
            500 => (6, Verb::Vent),
            550 => (4, Verb::Disarm),
            _ => (3, Verb::Capture),
        };
        let [state, order, about, description, aim] = [
            sample::<Track>(&pose, time),
            sample::<Duties>(&order, time),
            sample::<PoseReport>(&report(1), time),
            sample::<ConsoleCommand>(&command(verb.1), time),
            sample::<Target>(&target(), time),
        ];
        valves.step(
            k,
            time,
            &[
                (0, pieces::<Duties>(&order)),
                (1, pieces::<Track>(&state)),
                (2, pieces::<PoseReport>(&about)),
                (verb.0, pieces::<ConsoleCommand>(&description)),
            ],
        );
        let element: ActuationElement = valves.sent::<Actuation>(1);
        states[element.state as usize] += 1;
        let actuation = sample::<Actuation>(&element, time);
        let request = sample::<PlanRequest>(&REQUEST, time);
        let head = Header { stamp: time, origin: time, sequence: 0, incarnation: 0, count: 0 };
        let holds = PlanUpdateBody { standing: PlanStanding::Holds as u32, ..PlanUpdateBody::default() };
        let plan = AlignedBytes::copy_of(&[head.as_bytes(), holds.as_bytes()].concat());
        gate.step(
            k,
            time,
            &[
                (0, pieces::<Track>(&state)),
                (1, pieces::<Target>(&aim)),
                (2, pieces::<Actuation>(&actuation)),
                (3, pieces::<PoseReport>(&about)),
                (4, pieces::<PlanUpdate>(&plan)),
                (5, pieces::<PlanRequest>(&request)),
            ],
        );
        beams += u64::from(gate.sent::<Gate>(1).beam);
    }
    assert!(states.iter().all(|n| *n > 0) && beams > 100, "{states:?} {beams}");
    assert_eq!((valves.allocations, gate.allocations), (0, 0));
    // The counter counts: a test that cannot fail proves nothing.
    assert!(allocation_counter::measure(|| drop(std::hint::black_box(vec![1_u8; 64]))).count_total > 0);
}
