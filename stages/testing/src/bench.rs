//! One operator, activated with samples that a test makes.

use std::sync::Arc;

use stillpoint_operator::Files;
use stillpoint_operator::outside::Outside;
use stillpoint_operator::{Registry, Stage};
use stillpoint_pipeline::config::check;
use stillpoint_pipeline::drafts::{Buffer, Lender};
use stillpoint_pipeline::graph::Graph;
use stillpoint_pipeline::instance::OperatorInstance;
use stillpoint_pipeline::record::Record;
use stillpoint_pipeline::sample_store::OwnedSample;
use stillpoint_samples::{
    Cause, Header, JournalRef, Outcome, RefKind, Sample, SampleKind, Setting, SettingAnswer,
    SettingAnswerElement, SettingElement,
};

use crate::feed;
use crate::run::START;
use crate::sample::bytes_of;

/// One operator of a pipeline on the bench.
pub struct Bench {
    instance: OperatorInstance,
    kinds: Vec<&'static SampleKind>,
    time: u64,
    next: Option<u64>,
    sequence: u64,
    padding: usize,
}

/// What an activation left behind.
pub struct Left {
    /// The outputs with the number of their port, in the order of sending.
    pub outputs: Vec<(usize, OwnedSample)>,
    /// What the operator said where the activation failed.
    pub fault: Option<String>,
    /// It failed by a panic.
    pub panicked: bool,
}

impl Bench {
    /// Puts the operator `name` of a pipeline on the bench. The pipeline may use `feed.image`, `feed.cloud`,
    /// `feed.pose`, `feed.report`, `feed.track` and `feed.rejection` (output `out`) besides the kinds of `stages`.
    ///
    /// # Errors
    /// The faults of the text, or why the operator cannot be made.
    pub fn new(text: &str, name: &str, stages: &[Stage], files: &dyn Files) -> Result<Self, String> {
        Self::with_outside(text, name, stages, files, Outside::default())
    }

    /// As [`new`](Self::new), for a source that takes messages from outside the pipeline.
    ///
    /// # Errors
    /// As of [`new`](Self::new).
    pub fn with_outside(
        text: &str,
        name: &str,
        stages: &[Stage],
        files: &dyn Files,
        outside: Outside,
    ) -> Result<Self, String> {
        let registry = Registry::new(&[feed::STAGES, stages]);
        let graph: Graph = check(text, "bench.yaml", &[], &registry, files).map_err(|f| f.to_string())?;
        let graph = Arc::new(graph);
        let operator = graph.operator(name).ok_or_else(|| format!("there is no operator {name}"))?;
        let instance = OperatorInstance::build(&graph, operator, 0, files, outside, &[]).map_err(|e| e.0)?;
        let kinds = graph.operators[operator].stage.kind.outputs.iter().map(|o| o.sample).collect();
        Ok(Self { instance, kinds, time: START, next: None, sequence: 0, padding: 0 })
    }

    /// Lends buffers that are this many bytes longer than needed, with different content each time: bytes beyond the
    /// count of a sample must have no effect.
    pub fn padded(mut self, bytes: usize) -> Self {
        self.padding = bytes;
        self
    }

    /// Feeds a sample to an input, 10 ms after the last activation where [`at`](Self::at) does not say else, acquired `age` ns before;
    /// of less than 0, it comes from a clock that is ahead.
    pub fn feed<S: Sample>(
        &mut self,
        port: usize,
        body: &S::Body,
        elements: &[S::Element],
        age: i64,
    ) -> Left {
        self.advance();
        let header = Header {
            stamp: self.time,
            origin: self.time.saturating_add_signed(-age),
            sequence: self.sequence,
            incarnation: 0,
            count: elements.len() as u32,
        };
        let bytes = Arc::new(bytes_of::<S>(&header, body, elements));
        let owned = OwnedSample { kind: S::KIND, bytes };
        let reference = JournalRef {
            first: self.sequence,
            total: self.sequence + 1,
            lost: 0,
            passed: 0,
            count: 1,
            incarnation: 0,
            port: port as u32,
            kind: RefKind::Fresh as u32,
        };
        self.sequence += 1;
        self.activate(Cause::Input, port, vec![reference], Some(&owned))
    }

    /// Changes a live parameter, `operator.parameter`, 10 ms after the last activation where [`at`](Self::at) does not say
    /// else. Gives the answer of the operator; `None`: it is not meant, or has no live parameters.
    pub fn set(&mut self, path: &str, value: &str) -> Option<SettingAnswerElement> {
        self.advance();
        let header =
            Header { stamp: self.time, origin: self.time, sequence: self.sequence, incarnation: 0, count: 1 };
        let change = SettingElement::new(path, value, "bench")?;
        let bytes = Arc::new(bytes_of::<Setting>(&header, &(), &[change]));
        self.sequence += 1;
        let left =
            self.activate(Cause::Set, 0, Vec::new(), Some(&OwnedSample { kind: Setting::KIND, bytes }));
        let answer = left.outputs.iter().find(|(_, owned)| *owned.kind == *SettingAnswer::KIND);
        answer.and_then(|(_, owned)| owned.pieces().view::<SettingAnswer>().ok()?.first().copied())
    }

    /// Sets the time of the next activation: this many ns after the first possible time.
    pub fn at(&mut self, ns: u64) -> &mut Self {
        self.next = Some(START + ns);
        self
    }

    /// Lets the timer tick, 10 ms after the last activation.
    pub fn tick(&mut self) -> Left {
        self.advance();
        self.activate(Cause::Timer, 0, Vec::new(), None)
    }

    fn advance(&mut self) {
        self.time = self.next.take().unwrap_or(self.time + 10_000_000);
    }

    fn activate(
        &mut self,
        cause: Cause,
        port: usize,
        inputs: Vec<JournalRef>,
        owned: Option<&OwnedSample>,
    ) -> Left {
        let record = Record { time: self.time, nominal: self.time, tick: self.sequence, cause, port, inputs };
        let mut heap = Heap { kinds: &self.kinds, padding: self.padding };
        let sample = |p: usize| owned.filter(|_| p == port).map(OwnedSample::pieces);
        let entry = self.instance.activate(&record, &sample, &mut heap);
        let outcome = entry.outcome();
        let fault =
            self.instance.fault().filter(|_| outcome.is_none_or(Outcome::is_failure)).map(str::to_string);
        let kinds = &self.kinds;
        let outputs = self.instance.take_drafts();
        let outputs =
            outputs.map(|d| (d.port, OwnedSample::copy_of(kinds[d.port], d.buffer.pieces()))).collect();
        Left { outputs, fault, panicked: outcome == Some(Outcome::Panic) }
    }
}

impl Left {
    /// The bytes of all outputs, heads included.
    pub fn bytes(&self) -> Vec<u8> {
        self.outputs.iter().flat_map(|(_, p)| p.bytes.iter().copied()).collect()
    }
}

struct Heap<'k> {
    kinds: &'k [&'static SampleKind],
    padding: usize,
}

impl Lender for Heap<'_> {
    fn loan(&mut self, port: usize, elements: usize) -> Option<Buffer> {
        let kind = self.kinds.get(port)?;
        let mut buffer = Buffer::heap(kind, elements + self.padding);
        // What a buffer in shared memory held before.
        buffer.parts_mut().1.fill(self.padding as u8);
        Some(buffer)
    }
}
