//! One operator with its buffers made beforehand, so that a step can be watched alone: what it takes from the heap, say.

use stillpoint_operator::Outputs;
use stillpoint_operator::activation::{Activation, ActivationInput, Consumed, RandomKey};
use stillpoint_operator::{ErasedOperator, Registry, Stage};
use stillpoint_operator::{Files, Setup};
use stillpoint_pipeline::config::check;
use stillpoint_pipeline::drafts::{Buffer, Draft, DraftBuffers, Lender};
use stillpoint_samples::{Cause, Pieces, Sample, SampleKind, View};

use crate::feed;

/// The most samples that a step may send here.
const DRAFTS: usize = 8;

/// An operator with all that a step of it touches.
pub struct Quiet {
    operator: Box<dyn ErasedOperator>,
    inputs: usize,
    laps: usize,
    kinds: Vec<(&'static SampleKind, usize)>,
    stock: Stock,
    drafts: Vec<Draft>,
    steps: u64,
}

/// Lends what was made before, as shared memory does.
struct Stock(Vec<Option<Buffer>>);

impl Lender for Stock {
    fn loan(&mut self, port: usize, _: usize) -> Option<Buffer> {
        self.0[port].take()
    }
}

impl Quiet {
    /// The operator `name` of a pipeline, which may use the kinds of [`feed`] besides those of `stages`.
    ///
    /// # Errors
    /// The faults of the text, or why the operator cannot be made.
    pub fn new(text: &str, name: &str, stages: &[Stage], files: &dyn Files) -> Result<Self, String> {
        let registry = Registry::new(&[feed::STAGES, stages]);
        let graph = check(text, "quiet.yaml", &[], &registry, files).map_err(|f| f.to_string())?;
        let number = graph.operator(name).ok_or_else(|| format!("there is no operator {name}"))?;
        let node = &graph.operators[number];
        let connected: Vec<_> = node.inputs.iter().map(|i| i.edge.is_some()).collect();
        let input_frames: Vec<_> = node.inputs.iter().map(|i| i.frame.clone()).collect();
        let output_frames: Vec<_> = node.outputs.iter().map(|o| o.frame.clone()).collect();
        let setup = Setup {
            operator: name,
            every: node.every,
            connected: &connected,
            input_frames: &input_frames,
            output_frames: &output_frames,
            frames: &graph.frames,
            files,
            outside: Default::default(),
        };
        let operator = (node.stage.build)(&node.params, &setup).map_err(|e| e.0)?;
        let kinds: Vec<_> =
            node.stage.kind.outputs.iter().zip(&node.outputs).map(|(o, n)| (o.sample, n.capacity)).collect();
        Ok(Self {
            operator,
            inputs: node.inputs.len(),
            laps: node.stage.laps.len(),
            stock: Stock(kinds.iter().map(|_| None).collect()),
            kinds,
            drafts: Vec::with_capacity(DRAFTS),
            steps: 0,
        })
    }

    /// Lets the timer tick at `time`, ns. `watch` gets the step, and has to do it.
    ///
    /// # Errors
    /// What the operator says.
    pub fn tick<R>(&mut self, time: u64, watch: impl FnOnce(&mut dyn FnMut()) -> R) -> Result<R, String> {
        self.step(Cause::Timer, 0, time, None, watch)
    }

    /// Feeds a sample to an input at `time`, ns. `watch` gets the step, and has to do it.
    ///
    /// # Errors
    /// What the operator says.
    pub fn feed<R>(
        &mut self,
        port: usize,
        time: u64,
        sample: Pieces<'_>,
        watch: impl FnOnce(&mut dyn FnMut()) -> R,
    ) -> Result<R, String> {
        self.step(Cause::Input, port, time, Some(sample), watch)
    }

    fn step<R>(
        &mut self,
        cause: Cause,
        port: usize,
        time: u64,
        sample: Option<Pieces<'_>>,
        watch: impl FnOnce(&mut dyn FnMut()) -> R,
    ) -> Result<R, String> {
        self.drafts.clear();
        for (slot, (kind, capacity)) in self.stock.0.iter_mut().zip(&self.kinds) {
            *slot = Some(Buffer::heap(kind, *capacity));
        }
        let mut inputs = vec![ActivationInput::default(); self.inputs];
        if let Some(pieces) = sample {
            inputs[port].sample = Some(Consumed { pieces, held: false });
        }
        let activation = Activation {
            index: self.steps,
            time,
            nominal: time,
            tick: self.steps,
            origin: time,
            cause,
            port,
            inputs: &inputs,
            key: RandomKey::default(),
        };
        self.steps += 1;
        let Self { operator, laps, kinds, stock, drafts, .. } = self;
        let mut done = None;
        let seen = watch(&mut || {
            let mut buffers = DraftBuffers::new(kinds, stock, drafts);
            let mut outputs = Outputs::new(kinds, *laps, &mut buffers);
            done = Some(operator.step(&activation, &mut outputs));
        });
        match done {
            Some(Ok(())) => Ok(seen),
            Some(Err(error)) => Err(error.0),
            None => Err("the step was not done".into()),
        }
    }

    /// What the last step sent on an output, if it did.
    pub fn sent<S: Sample>(&self, port: usize) -> Option<View<'_, S>> {
        self.drafts.iter().find(|d| d.port == port)?.buffer.pieces().view::<S>().ok()
    }

    pub fn steps(&self) -> u64 {
        self.steps
    }
}
