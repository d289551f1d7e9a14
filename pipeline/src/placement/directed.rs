//! An operator whose activations are decided elsewhere.

use std::sync::Arc;

use stillpoint_samples::{Cause, Entry, JournalRef, Outcome, RefKind, SampleKind};

use super::{Begin, Carried, Committed, PlacementError};
use crate::clock::float_state_is_standard;
use crate::drafts::{Buffer, Lender};
use crate::graph::Graph;
use crate::instance::OperatorInstance;
use crate::operator::Files;
use crate::operator::Policy;
use crate::outside::Outside;
use crate::record::Record;
use crate::sample_store::{OwnedSample, SampleStore};
use crate::settings::TakenChange;

/// One operator: its present incarnation, and the samples that wait for it.
pub struct Directed {
    graph: Arc<Graph>,
    operator: usize,
    instance: Option<OperatorInstance>,
    /// The changes of parameters that incarnations before took.
    changes: Vec<TakenChange>,
    store: SampleStore,
}

impl Directed {
    /// Operator number `operator`, without an incarnation yet.
    pub fn new(graph: Arc<Graph>, operator: usize) -> Self {
        Self { graph, operator, instance: None, changes: Vec::new(), store: SampleStore::default() }
    }

    fn name(&self) -> &str {
        &self.graph.operators[self.operator].name
    }

    /// Begins an incarnation.
    pub fn start(&mut self, begin: Begin, files: &dyn Files) -> Result<Entry, PlacementError> {
        let Begin { incarnation, time, carried } = begin;
        if !float_state_is_standard() {
            return Err(PlacementError::Setup {
                operator: self.name().to_string(),
                reason: "its thread does not round to nearest, or flushes subnormal numbers to zero"
                    .to_string(),
            });
        }
        if let Some(before) = self.instance.take() {
            self.changes = before.changes().to_vec();
        }
        if let Carried::First(carried) = carried {
            let known = self.changes.len();
            if carried > known as u64 {
                let operator = self.name().to_string();
                return Err(PlacementError::Changes { operator, incarnation, carried, known });
            }
            self.changes.truncate(carried as usize);
        }
        let outside = Outside::default();
        let built =
            OperatorInstance::build(&self.graph, self.operator, incarnation, files, outside, &self.changes);
        let built =
            built.map_err(|e| PlacementError::Setup { operator: self.name().to_string(), reason: e.0 })?;
        Ok(self.instance.insert(built).mark(Cause::Start, time, &[]))
    }

    /// Puts a sample where activations will find it.
    pub fn deliver(&mut self, port: usize, owned: OwnedSample) {
        self.store.put(port, owned);
    }

    /// Does one activation.
    pub fn activate(&mut self, record: &Record) -> Result<Committed, PlacementError> {
        for r in &record.inputs {
            if self.store.get(r.port as usize, r.incarnation, r.first).is_none() {
                return Err(PlacementError::Sample {
                    operator: self.name().to_string(),
                    port: r.port,
                    incarnation: r.incarnation,
                    sequence: r.first,
                });
            }
        }
        let node = &self.graph.operators[self.operator];
        let instance = self.instance.as_mut().ok_or_else(|| gone(&node.name))?;
        let store = &self.store;
        let find = |port: usize| {
            let r = record.inputs.iter().find(|r| r.port as usize == port)?;
            Some(store.get(port, r.incarnation, r.first)?.pieces())
        };
        let mut heap = Heap { kinds: node.stage.kind.outputs.iter().map(|o| o.sample).collect() };
        let entry = instance.activate(record, &find, &mut heap);
        let fault = entry
            .outcome()
            .is_none_or(Outcome::is_failure)
            .then(|| instance.fault().unwrap_or_default().to_string());
        let outputs = instance
            .take_drafts()
            .map(|draft| {
                let kind = node.stage.kind.outputs[draft.port].sample;
                (draft.port, OwnedSample::of(kind, draft.buffer))
            })
            .collect();
        for r in &record.inputs {
            let port = r.port as usize;
            // A `latest` sample may be named again; anything else is consumed once.
            let held = node.inputs.get(port).is_some_and(|i| i.policy == Policy::Latest);
            if held || r.kind == RefKind::Held as u32 {
                self.store.forget_before(port, r.incarnation, r.first);
            } else {
                self.store.forget_before(port, r.incarnation, r.first + 1);
            }
        }
        Ok(Committed { entry, outputs, fault })
    }

    /// Ends the incarnation in order.
    pub fn end(&mut self, time: u64, inputs: &[JournalRef]) -> Result<Entry, PlacementError> {
        let name = self.name().to_string();
        let mut instance = self.instance.take().ok_or_else(|| gone(&name))?;
        self.changes = instance.changes().to_vec();
        Ok(instance.mark(Cause::End, time, inputs))
    }
}

fn gone(operator: &str) -> PlacementError {
    PlacementError::Gone { operator: operator.to_string(), reason: "it has no incarnation".to_string() }
}

struct Heap {
    kinds: Vec<&'static SampleKind>,
}

impl Lender for Heap {
    fn loan(&mut self, port: usize, elements: usize) -> Option<Buffer> {
        Some(Buffer::heap(self.kinds.get(port)?, elements))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::operator::files::MemoryFiles;
    use crate::operator::{Kind, Operator, Registry, Role, SetupError, Stage, StepError, Timer};
    use stillpoint_operator::{Activation, Outputs, Setup};

    /// Ends at its first activation.
    struct Short;

    impl Operator for Short {
        type Params = ();
        const KIND: Kind = Kind {
            name: "test.short",
            about: "Ends at its first activation.",
            role: Role::Source,
            inputs: &[],
            outputs: &[],
            timer: Timer::Required,
        };

        fn new((): (), _: &Setup<'_>) -> Result<Self, SetupError> {
            Ok(Self)
        }

        fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
            if activation.index > 0 {
                return Err(StepError("it goes on".to_string()));
            }
            outputs.finish();
            Ok(())
        }
    }

    #[test]
    fn an_operator_that_finishes_has_not_failed() {
        let text = "stillpoint: 1\nname: short\noperators: { short: { use: test.short, every: 10 ms } }\n";
        let registry = Registry::new(&[&[Stage::of::<Short>()]]);
        let files = MemoryFiles::default();
        let graph = crate::config::check(text, "short.yaml", &[], &registry, &files).unwrap();
        let mut directed = Directed::new(Arc::new(graph), 0);
        directed.start(Begin { incarnation: 0, time: 0, carried: Carried::All }, &files).unwrap();
        let record = |time| Record {
            time,
            nominal: time,
            tick: time,
            cause: Cause::Timer,
            port: 0,
            inputs: Vec::new(),
        };
        let finished = directed.activate(&record(1)).unwrap();
        assert_eq!((finished.entry.outcome(), finished.fault), (Some(Outcome::Finished), None));
        let failed = directed.activate(&record(2)).unwrap();
        assert_eq!(failed.fault.as_deref(), Some("it goes on"));
    }
}
