//! One operator in a test: inputs, clock and restarts are in the hands of the test, and what a step sends is compared.
//!
//! ```
//! # use stillpoint_operator::*;
//! use stillpoint_operator::bench::Bench;
//! use stillpoint_operator::samples::{Diagnostics, Metric, Sample};
//! # #[derive(Clone, Params)]
//! # struct DoubleParams { /// Factor.
//! #     #[param(default = 2.0)] factor: f64 }
//! # struct Double(f64);
//! # impl Operator for Double {
//! #     type Params = DoubleParams;
//! #     const KIND: Kind = Kind {
//! #         name: "my.double", about: "Doubles.", role: Role::Operator, timer: Timer::No,
//! #         inputs: &[Input { name: "in", sample: Diagnostics::KIND, policy: Policy::Queue(1), required: true, about: "." }],
//! #         outputs: &[Output { name: "out", sample: Diagnostics::KIND, frame: FrameRule::None, about: "." }],
//! #     };
//! #     fn new(params: DoubleParams, _: &Setup<'_>) -> Result<Self, SetupError> { Ok(Self(params.factor)) }
//! #     fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
//! #         let Some(sample) = activation.input::<Diagnostics>(0) else { return Ok(()) };
//! #         let doubled: Vec<Metric> = sample.elements.iter().map(|m| Metric::new("x", m.value * self.0)).collect();
//! #         outputs.send_slice::<Diagnostics>(0, &(), &doubled)
//! #     }
//! # }
//! let mut bench = Bench::new::<Double>("factor: 3").unwrap();
//! let left = bench.feed::<Diagnostics>(0, &(), &[Metric::new("x", 2.0)]);
//! assert_eq!(left.sent::<Diagnostics>(0)[0].elements[0].value, 6.0);
//! bench.restart().unwrap();
//! ```

use std::panic::{AssertUnwindSafe, catch_unwind};

use stillpoint_samples::{Cause, HEADER_SIZE, Header, Pieces, Sample, SampleKind, View, fnv1a, fnv1a_start};
use zerocopy::IntoBytes;

use crate::activation::{Activation, ActivationInput, Consumed, RandomKey};
use crate::config::faults::{Faults, Findings};
use crate::config::source::{Sources, Span};
use crate::config::tree::{Entry, Node, Value};
use crate::config::yaml;
use crate::error::SetupError;
use crate::files::MemoryFiles;
use crate::frames::Frames;
use crate::kind::Policy;
use crate::operator::{ErasedOperator, Operator};
use crate::outputs::Outputs;
use crate::outside::Outside;
use crate::params::CheckedParams;
use crate::program::buffers::{Buffers, Sent};
use crate::program::params::read;
use crate::setup::Setup;
use crate::stage::Stage;

/// Time of the first activation, ns, and from one to the next where a test sets none.
const STEP: u64 = 10_000_000;

/// Why an operator cannot be put on the bench.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// Its parameters have faults.
    #[error("{0}")]
    Params(Faults),
    /// Its parameters do not go together.
    #[error("{0}")]
    Conflict(#[from] crate::error::ParamConflict),
    /// It refuses to start.
    #[error("{0}")]
    Setup(#[from] SetupError),
}

/// One operator with the state of its incarnation.
pub struct Bench {
    stage: Stage,
    params: CheckedParams,
    files: MemoryFiles,
    step: Box<dyn ErasedOperator>,
    kinds: Vec<(&'static SampleKind, usize)>,
    held: Vec<Option<Sent>>,
    time: u64,
    next: Option<u64>,
    index: u64,
    tick: u64,
    incarnation: u32,
    sequence: u64,
}

/// What an activation left behind.
#[derive(Debug)]
pub struct Left {
    outputs: Vec<Sent>,
    /// Why the step failed, by an error or a panic.
    pub fault: Option<String>,
    /// It panicked: in a run, the operator would begin anew.
    pub panicked: bool,
    /// The operator said that it has finished.
    pub finished: bool,
}

impl Left {
    /// The samples that were sent on an output, in order; none where the step failed.
    pub fn sent<S: Sample>(&self, port: usize) -> Vec<View<'_, S>> {
        let of_port = self.outputs.iter().filter(|sent| sent.port == port);
        of_port.filter_map(|sent| pieces(sent).view::<S>().ok()).collect()
    }

    /// The bytes of everything that was sent: equal for equal steps.
    pub fn bytes(&self) -> Vec<(usize, Vec<u8>)> {
        let all =
            |sent: &Sent| (sent.port, [&sent.meta.get()[HEADER_SIZE - 4..], sent.payload.get()].concat());
        self.outputs.iter().map(all).collect()
    }
}

fn pieces(sent: &Sent) -> Pieces<'_> {
    Pieces { meta: sent.meta.get(), payload: sent.payload.get() }
}

impl Bench {
    /// Puts an operator on the bench. `params` are its parameters as a pipeline has them, `leaf: 4 mm`; each line is one.
    ///
    /// # Errors
    /// The parameters have faults, or the operator refuses to start.
    pub fn new<T: Operator>(params: &str) -> Result<Self, BenchError> {
        Self::with_files::<T>(params, MemoryFiles::default())
    }

    /// The same with files that parameters name.
    ///
    /// # Errors
    /// As of [`new`](Self::new).
    pub fn with_files<T: Operator>(params: &str, files: MemoryFiles) -> Result<Self, BenchError> {
        let stage = Stage::of::<T>();
        let findings = Findings::default();
        let entries: Vec<Entry> = match yaml::parse(params, 0, 0, &findings) {
            Some(Node { value: Value::Map(entries), .. }) => entries,
            Some(node) => {
                node.refuse("the text of the parameters", "a mapping such as `leaf: 4 mm`", &findings);
                Vec::new()
            }
            // An empty text is no parameter.
            None => Vec::new(),
        };
        let place = Span { line: 1, column: 1, ..Span::default() };
        let found = read(&stage, &entries, place, &files);
        for fault in found.faults {
            findings.say(fault.span, fault.code, fault.message, fault.help);
        }
        let params = match found.checked {
            Some(params) if findings.is_empty() => params,
            _ => return Err(BenchError::Params(findings.into_faults(Sources::new("params", params, &[])))),
        };
        (stage.validate)(&params)?;
        (stage.check_files)(&params, &files)?;
        let capacities = (stage.capacities)(&params);
        let outputs = stage.kind.outputs.iter().enumerate();
        let kinds = outputs.map(|(port, o)| (o.sample, capacities.get(port).copied().unwrap_or(1))).collect();
        let step = made(&stage, &params, &files)?;
        let held = stage.kind.inputs.iter().map(|_| None).collect();
        let (time, next, index, tick, incarnation, sequence) = (0, None, 0, 0, 0, 0);
        Ok(Self { stage, params, files, step, kinds, held, time, next, index, tick, incarnation, sequence })
    }

    /// Sets the time of the next activation, ns. Without it, each is 10 ms after the one before.
    pub fn at(&mut self, time: u64) -> &mut Self {
        self.next = Some(time);
        self
    }

    /// Feeds a sample to an input, acquired at the time of the activation that it causes.
    ///
    /// # Panics
    /// The kind has no such input, or it takes another type of sample.
    pub fn feed<S: Sample>(&mut self, port: usize, body: &S::Body, elements: &[S::Element]) -> Left {
        self.hold::<S>(port, body, elements);
        self.activate(Cause::Input, port)
    }

    /// Lets a sample wait on an input without an activation, as `latest` does: the next one sees it.
    ///
    /// # Panics
    /// The kind has no such input, or it takes another type of sample: a test would test nothing.
    pub fn hold<S: Sample>(&mut self, port: usize, body: &S::Body, elements: &[S::Element]) {
        let input = self.stage.kind.inputs.get(port);
        let taken = input.map(|input| input.sample.type_name());
        assert_eq!(
            taken,
            Some(S::KIND.type_name()),
            "the sample of input {port} of {}",
            self.stage.kind.name
        );
        let time = self.upcoming();
        let kinds = [(S::KIND, elements.len().max(1))];
        let mut buffers = Buffers::new(&kinds);
        let sent = Outputs::new(&kinds, 0, &mut buffers).send_slice::<S>(0, body, elements);
        assert_eq!(sent.err().map(|e| e.0), None, "a sample for input {port}");
        let Some(mut sample) = buffers.stored.pop() else { return };
        let count = elements.len() as u32;
        let header = Header { stamp: time, origin: time, sequence: self.sequence, incarnation: 0, count };
        sample.meta.get_mut()[..HEADER_SIZE].copy_from_slice(header.as_bytes());
        self.sequence += 1;
        self.held[port] = Some(sample);
    }

    /// Lets the timer tick.
    pub fn tick(&mut self) -> Left {
        let left = self.activate(Cause::Timer, 0);
        self.tick += 1;
        left
    }

    /// Begins a new incarnation, as a run does after a panic: the state is gone, and samples that were held stay.
    ///
    /// # Errors
    /// The operator refuses to start.
    pub fn restart(&mut self) -> Result<(), SetupError> {
        self.step = made(&self.stage, &self.params, &self.files)?;
        self.incarnation += 1;
        self.index = 0;
        Ok(())
    }

    fn upcoming(&self) -> u64 {
        self.next.unwrap_or(self.time + STEP)
    }

    fn activate(&mut self, cause: Cause, port: usize) -> Left {
        self.time = self.upcoming();
        self.next = None;
        let is_held = |input: usize| cause != Cause::Input || input != port;
        let inputs: Vec<ActivationInput<'_>> = self
            .held
            .iter()
            .enumerate()
            .map(|(input, held)| ActivationInput {
                sample: held.as_ref().map(|sample| Consumed { pieces: pieces(sample), held: is_held(input) }),
                ..ActivationInput::default()
            })
            .collect();
        let origins = inputs.iter().filter_map(|input| Some(input.sample?.pieces.header().origin));
        let activation = Activation {
            index: self.index,
            time: self.time,
            nominal: self.time,
            tick: self.tick,
            origin: origins.min().unwrap_or(self.time),
            cause,
            port,
            inputs: &inputs,
            key: RandomKey {
                seed: 1,
                operator: fnv1a(fnv1a_start(), self.stage.kind.name.as_bytes()),
                incarnation: self.incarnation,
            },
        };
        let mut buffers = Buffers::new(&self.kinds);
        let mut outputs = Outputs::new(&self.kinds, self.stage.laps.len(), &mut buffers);
        let step = &mut self.step;
        let result = catch_unwind(AssertUnwindSafe(|| step.step(&activation, &mut outputs)));
        let finished = outputs.report().finished;
        let outputs = std::mem::take(&mut buffers.stored);
        self.index += 1;
        // A queue gives a sample once; the newest sample of another input stays.
        if cause == Cause::Input
            && matches!(self.stage.kind.inputs.get(port).map(|i| i.policy), Some(Policy::Queue(_)))
        {
            self.held[port] = None;
        }
        match result {
            Ok(Ok(())) => Left { outputs, fault: None, panicked: false, finished },
            Ok(Err(error)) => Left { outputs: Vec::new(), fault: Some(error.0), panicked: false, finished },
            Err(panic) => {
                let fault = Some(crate::program::panic_text(&*panic));
                Left { outputs: Vec::new(), fault, panicked: true, finished }
            }
        }
    }
}

fn made(
    stage: &Stage,
    params: &CheckedParams,
    files: &MemoryFiles,
) -> Result<Box<dyn ErasedOperator>, SetupError> {
    let (inputs, outputs) = (stage.kind.inputs.len(), stage.kind.outputs.len());
    let setup = Setup {
        operator: "bench",
        every: None,
        connected: &vec![true; inputs],
        input_frames: &vec![None; inputs],
        output_frames: &vec![None; outputs],
        frames: &Frames::default(),
        files,
        outside: Outside::default(),
    };
    (stage.build)(params, &setup)
}
