//! An instance: one incarnation of an operator with its counters. Every placement runs activations through it.

use std::panic::{AssertUnwindSafe, catch_unwind};

use stillpoint_samples::{
    Cause, Entry, HEADER_SIZE, Header, JournalBody, JournalRef, Outcome, Pieces, RefKind, SampleKind,
    Setting, SettingAnswer, fnv1a, fnv1a_start,
};
use zerocopy::IntoBytes;

use crate::activation::{Activation, ActivationInput, Consumed, RandomKey};
use crate::drafts::{Draft, DraftBuffers, Lender};
use crate::graph::{AgeLimit, Graph, LateInput, OperatorNode};
use crate::operator::{ErasedOperator, SetupError, StepError};
use crate::operator::{Files, Setup};
use crate::outputs::Outputs;
use crate::outside::Outside;
use crate::params::SetError;
use crate::programs::Killed;
use crate::record::Record;
use crate::settings::{Settings, TakenChange, with_changes};

/// One incarnation of an operator.
pub struct OperatorInstance {
    step: Box<dyn ErasedOperator>,
    /// Its parameters, where some of them are live.
    settings: Option<Settings>,
    kinds: Vec<(&'static SampleKind, usize)>,
    laps: &'static [&'static str],
    key: RandomKey,
    /// Number of the next activation.
    index: u64,
    /// Number of the next journal entry.
    entries: u64,
    inputs: Vec<Seen>,
    /// How old a sample of each input may be.
    limits: Vec<Option<AgeLimit>>,
    input_names: Vec<&'static str>,
    sent: Vec<Sent>,
    drafts: Vec<Draft>,
    fault: Option<String>,
    /// A signal has ended the program that does its steps.
    is_killed: bool,
}

/// The last sample that an input brought.
#[derive(Clone, Copy, Default)]
struct Seen {
    incarnation: Option<u32>,
    lost: u64,
}

/// The samples that an output has sent.
#[derive(Clone, Copy, Default)]
struct Sent {
    next: u64,
    lost: u64,
}

impl OperatorInstance {
    /// Makes an incarnation of operator number `operator`, which begins with the `changes` that earlier ones took.
    pub fn build(
        graph: &Graph,
        operator: usize,
        incarnation: u32,
        files: &dyn Files,
        outside: Outside,
        changes: &[TakenChange],
    ) -> Result<Self, SetupError> {
        let refused = |e: SetError| SetupError(format!("it cannot begin with the changes before: {e}"));
        let node = &with_changes(&graph.operators[operator], changes).map_err(refused)?;
        Ok(Self {
            step: build_step(graph, node, files, outside)?,
            settings: Settings::of(node, changes),
            kinds: node
                .stage
                .kind
                .outputs
                .iter()
                .zip(&node.outputs)
                .map(|(port, output)| (port.sample, output.capacity))
                .collect(),
            laps: node.stage.laps,
            key: RandomKey {
                seed: graph.seed,
                operator: fnv1a(fnv1a_start(), node.name.as_bytes()),
                incarnation,
            },
            index: 0,
            entries: 0,
            // A step does not see changes of parameters.
            inputs: vec![Seen::default(); node.inputs.len() - usize::from(node.stage.is_live())],
            limits: node.inputs.iter().map(|i| i.max_age).collect(),
            input_names: node.stage.kind.inputs.iter().map(|i| i.name).collect(),
            sent: vec![Sent::default(); node.outputs.len()],
            drafts: Vec::new(),
            fault: None,
            is_killed: false,
        })
    }

    /// Number of the incarnation.
    pub fn incarnation(&self) -> u32 {
        self.key.incarnation
    }

    /// The changes of parameters that this incarnation and those before it took, the oldest first.
    pub fn changes(&self) -> &[TakenChange] {
        self.settings.as_ref().map_or(&[], Settings::changes)
    }

    /// The reason of the last activation that failed.
    pub fn fault(&self) -> Option<&str> {
        self.fault.as_deref()
    }

    /// Whether a signal has ended the program that does its steps. Nothing in its journal can cause that again.
    pub fn is_killed(&self) -> bool {
        self.is_killed
    }

    fn panicked(&mut self, panic: &(dyn std::any::Any + Send)) {
        self.is_killed = panic.is::<Killed>();
        self.fault = Some(panic_text(panic));
    }

    /// The entry that marks the beginning or the end of the incarnation. The tick of a beginning is the number of changes of
    /// parameters that it begins with.
    pub fn mark(&mut self, cause: Cause, time: u64, inputs: &[JournalRef]) -> Entry {
        let mut refs = inputs.to_vec();
        if cause == Cause::End {
            refs.extend(
                self.sent
                    .iter()
                    .enumerate()
                    .map(|(port, sent)| output_ref(port, sent, 0, self.key.incarnation)),
            );
        }
        let tick = if cause == Cause::Start { self.changes().len() as u64 } else { 0 };
        let record = Record { time, nominal: time, tick, cause, port: 0, inputs: Vec::new() };
        self.entry(&record, time, Outcome::Done, refs)
    }

    /// Does one activation. `sample` gives the bytes of the sample that an input brings. The outputs stand in
    /// [`drafts`](Self::take_drafts) afterwards, headed and ready; they may be sent only after the entry is published.
    pub fn activate<'a>(
        &mut self,
        record: &Record,
        sample: &dyn Fn(usize) -> Option<Pieces<'a>>,
        lender: &mut dyn Lender,
    ) -> Entry {
        self.drafts.clear();
        if record.cause == Cause::Set {
            return self.set(record, sample(record.port), lender);
        }
        // Most operators have few inputs: what need not be cleared need not be in the caches either.
        let mut few;
        let mut many;
        let brought: &mut [ActivationInput<'_>] = if self.inputs.len() <= FEW_INPUTS {
            few = [ActivationInput::default(); FEW_INPUTS];
            &mut few[..self.inputs.len()]
        } else {
            many = [ActivationInput::default(); MAX_INPUTS];
            &mut many[..self.inputs.len()]
        };
        let mut origin = None;
        let mut late = None;
        for r in &record.inputs {
            let port = r.port as usize;
            let (Some(slot), Some(seen)) = (brought.get_mut(port), self.inputs.get_mut(port)) else {
                continue;
            };
            let same = seen.incarnation == Some(r.incarnation);
            let mut pieces = sample(port);
            // Decided from the stamps of the activation alone, so that a replay decides the same.
            if let (Some(limit), Some(found)) = (self.limits[port], pieces)
                && let age = record.time.saturating_sub(found.header().origin)
                && age > limit.max
            {
                match limit.otherwise {
                    LateInput::Count => {}
                    LateInput::Skip => pieces = None,
                    LateInput::Hold => {
                        late.get_or_insert(None);
                    }
                    LateInput::Fault => {
                        let name = self.input_names.get(port).copied().unwrap_or_default();
                        late = Some(Some(too_old(name, age, limit.max)));
                    }
                }
            }
            *slot = ActivationInput {
                sample: pieces.map(|pieces| Consumed { pieces, held: r.kind == RefKind::Held as u32 }),
                missed: r.lost.saturating_sub(if same { seen.lost } else { 0 }),
                restarted: seen.incarnation.is_some() && !same,
            };
            *seen = Seen { incarnation: Some(r.incarnation), lost: r.lost };
            if let Some(pieces) = pieces {
                let o = pieces.header().origin;
                origin = Some(origin.map_or(o, |a: u64| a.min(o)));
            }
        }
        let activation = Activation {
            index: self.index,
            time: record.time,
            nominal: record.nominal,
            tick: record.tick,
            origin: origin.unwrap_or(record.time),
            cause: record.cause,
            port: record.port,
            inputs: brought,
            key: self.key,
        };
        let mut buffers = DraftBuffers::new(&self.kinds, lender, &mut self.drafts);
        let mut outputs = Outputs::new(&self.kinds, self.laps.len(), &mut buffers);
        let step = &mut self.step;
        let result = match late {
            None => contained(|| step.step(&activation, &mut outputs)),
            Some(None) => Ok(Ok(())),
            Some(Some(fault)) => Ok(Err(StepError(fault))),
        };
        let report = outputs.report();
        drop(buffers);
        let origin = report.origin.unwrap_or(activation.origin);
        let outcome = match (result, report.unknown_lap) {
            (Ok(Ok(())), None) if report.finished => Outcome::Finished,
            (Ok(Ok(())), None) => Outcome::Done,
            (Ok(Ok(())), Some(lap)) => {
                self.fault = Some(format!("there is no lap {lap}: LAPS names {}", self.laps.len()));
                Outcome::Error
            }
            (Ok(Err(error)), _) => {
                self.fault = Some(error.0);
                Outcome::Error
            }
            (Err(panic), _) => {
                self.panicked(&*panic);
                Outcome::Panic
            }
        };
        let mut refs = Vec::with_capacity(record.inputs.len() + self.sent.len());
        refs.extend_from_slice(&record.inputs);
        if outcome.is_failure() {
            self.drafts.clear();
        } else {
            self.head_drafts(record.time, origin, &mut refs);
        }
        self.index += 1;
        self.entry(record, origin, outcome, refs)
    }

    /// Takes a change of a parameter, if it is for this operator, and answers it.
    fn set(&mut self, record: &Record, sample: Option<Pieces<'_>>, lender: &mut dyn Lender) -> Entry {
        let change = sample.and_then(|pieces| {
            let view = pieces.view::<Setting>().ok()?;
            Some((view.header, *view.first()?))
        });
        let (step, from) = (&mut self.step, self.index);
        let answered = match (&mut self.settings, change) {
            (Some(settings), Some((header, change))) => {
                contained(|| settings.take(&header, &change, from, &mut **step))
            }
            _ => Ok(None),
        };
        let mut refs = record.inputs.clone();
        let outcome = match answered {
            Ok(None) => Outcome::Done,
            Ok(Some((port, answer))) => {
                match answer.refusal() {
                    None => tracing::info!(
                        "{} is {} in generation {}",
                        answer.path(),
                        answer.value(),
                        answer.generation
                    ),
                    Some(why) => tracing::warn!("{} was not set to {}: {why}", answer.path(), answer.value()),
                }
                let mut buffers = DraftBuffers::new(&self.kinds, lender, &mut self.drafts);
                let sent = Outputs::new(&self.kinds, 0, &mut buffers).send::<SettingAnswer>(port, &answer);
                drop(buffers);
                match sent {
                    Ok(()) => {
                        self.head_drafts(record.time, record.time, &mut refs);
                        Outcome::Done
                    }
                    Err(error) => {
                        self.fault = Some(error.0);
                        Outcome::Error
                    }
                }
            }
            Err(panic) => {
                self.panicked(&*panic);
                Outcome::Panic
            }
        };
        self.entry(record, record.time, outcome, refs)
    }

    /// The outputs of the last activation, in the order in which the operator sent them.
    pub fn take_drafts(&mut self) -> std::vec::Drain<'_, Draft> {
        self.drafts.drain(..)
    }

    /// Counts a sample of the last activation that found no memory when it was to be sent. The next entry says so.
    pub fn count_unsent(&mut self, port: usize) {
        if let Some(sent) = self.sent.get_mut(port) {
            sent.lost += 1;
        }
    }

    fn head_drafts(&mut self, stamp: u64, origin: u64, refs: &mut Vec<JournalRef>) {
        let incarnation = self.key.incarnation;
        for (port, sent) in self.sent.iter_mut().enumerate() {
            let mut count = 0;
            for draft in self.drafts.iter_mut().filter(|d| d.port == port) {
                let (meta, _) = draft.buffer.parts_mut();
                // The writer has put the element count in place.
                let n = [
                    meta[HEADER_SIZE - 4],
                    meta[HEADER_SIZE - 3],
                    meta[HEADER_SIZE - 2],
                    meta[HEADER_SIZE - 1],
                ];
                let header =
                    Header { stamp, origin, sequence: sent.next, incarnation, count: u32::from_le_bytes(n) };
                meta[..HEADER_SIZE].copy_from_slice(header.as_bytes());
                sent.next += 1;
                count += 1;
            }
            if count > 0 {
                refs.push(output_ref(port, sent, count, incarnation));
            }
        }
    }

    fn entry(&mut self, record: &Record, origin: u64, outcome: Outcome, refs: Vec<JournalRef>) -> Entry {
        let count = refs.len() as u32;
        let entry = Entry {
            header: Header {
                stamp: record.time,
                origin,
                sequence: self.entries,
                incarnation: self.key.incarnation,
                count,
            },
            body: JournalBody {
                index: self.index.saturating_sub(u64::from(!matches!(
                    record.cause,
                    Cause::Start | Cause::End | Cause::Set
                ))),
                nominal: record.nominal,
                tick: record.tick,
                sent_before: 0,
                cause: record.cause as u32,
                port: record.port as u32,
                outcome: outcome as u32,
                reserved: [0; 2],
                length: count,
            },
            refs,
        };
        self.entries += 1;
        entry
    }
}

fn too_old(input: &str, age: u64, max: u64) -> String {
    let ms = |ns: u64| ns as f64 * 1e-6;
    format!("the sample on `{input}` is too old: {:.3} ms (allowed: {} ms)", ms(age), ms(max))
}

/// The most inputs of an operator.
pub const MAX_INPUTS: usize = 16;
const FEW_INPUTS: usize = 2;

fn output_ref(port: usize, sent: &Sent, count: u32, incarnation: u32) -> JournalRef {
    JournalRef {
        first: sent.next - u64::from(count),
        total: sent.next,
        lost: sent.lost,
        passed: 0,
        count,
        incarnation,
        port: port as u32,
        kind: RefKind::Output as u32,
    }
}

/// Makes the step of an operator, as each start of it does.
pub(crate) fn build_step(
    graph: &Graph,
    node: &OperatorNode,
    files: &dyn Files,
    outside: Outside,
) -> Result<Box<dyn ErasedOperator>, SetupError> {
    let connected: Vec<_> = node.inputs.iter().map(|i| i.edge.is_some()).collect();
    let input_frames: Vec<_> = node.inputs.iter().map(|i| i.frame.clone()).collect();
    let output_frames: Vec<_> = node.outputs.iter().map(|o| o.frame.clone()).collect();
    let setup = Setup {
        operator: &node.name,
        every: node.every,
        connected: &connected,
        input_frames: &input_frames,
        output_frames: &output_frames,
        frames: &graph.frames,
        files,
        outside,
    };
    // A panic in `new` is a fault of the operator, too.
    contained(|| (node.stage.build)(&node.params, &setup)).unwrap_or_else(|panic| {
        Err(SetupError(format!("it panicked while it was made: {}", panic_text(&*panic))))
    })
}

thread_local! {
    static STEPPING: std::cell::Cell<bool> = const { std::cell::Cell::new(false) };
}

/// Whether this thread is in an operator's own code, so that a panic is its fault, and is contained.
pub fn is_stepping() -> bool {
    STEPPING.get()
}

/// Runs an operator's own code and holds its panic.
fn contained<T>(code: impl FnOnce() -> T) -> std::thread::Result<T> {
    STEPPING.set(true);
    let result = catch_unwind(AssertUnwindSafe(code));
    STEPPING.set(false);
    result
}

fn panic_text(panic: &(dyn std::any::Any + Send)) -> String {
    panic
        .downcast_ref::<&str>()
        .map(|s| (*s).to_string())
        .or_else(|| panic.downcast_ref::<String>().cloned())
        .or_else(|| panic.downcast_ref::<Killed>().map(|killed| killed.0.clone()))
        .unwrap_or_else(|| "a panic without words".to_string())
}
