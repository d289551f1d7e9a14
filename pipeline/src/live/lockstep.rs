//! Lock-step placement in processes: activations are sent to workers as records, samples go through shared memory.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use stillpoint_samples::{Entry, JournalRef, RefKind, SampleKind};
use stillpoint_shm::{Domain, Subscriber, Topic};

use super::barrier::{PATIENCE, connect, wait_until_made};
use super::children::{Child, ChildError, Launch, ReportedFault};
use super::contracts;
use super::control::{FromWorker, Hello, ToWorker, WireRecord, wire_refs};
use super::error::LiveError;
use super::journal::entry_of;
use super::reservation::{Retention, reserve};
use super::run_folder::{RunFolder, sweep_dead};
use crate::clock::SessionClock;
use crate::graph::Graph;
use crate::placement::{Begin, Committed, Placement, PlacementError};
use crate::record::Record;
use crate::run_source::RunSource;
use crate::sample_store::OwnedSample;

/// All processes of a graph, directed by a schedule.
pub struct Processes {
    graph: Arc<Graph>,
    children: Vec<Child>,
    journals: Vec<Subscriber>,
    /// By operator and output.
    taps: Vec<Vec<(Subscriber, &'static SampleKind)>>,
    // Dropped in this order: ports, then topics, then the node, then the folder.
    _topics: Vec<Topic>,
    _domain: Domain,
    _folder: RunFolder,
}

impl Processes {
    /// Starts every process of the graph, which was checked from `source`.
    pub fn start(graph: Arc<Graph>, launch: &Launch, source: &RunSource) -> Result<Self, LiveError> {
        sweep_dead()?;
        let folder = RunFolder::create()?;
        reserve(&graph, Retention::Nothing, &folder)?;
        let source = RunSource { files: source.files.copied_to(&folder.files())?, ..source.clone() };
        let domain = Domain::create(&folder.root(), folder.prefix(), "supervisor")?;
        let mut topics = Vec::new();
        let (mut journals, mut taps) = (Vec::new(), Vec::new());
        for (operator, node) in graph.operators.iter().enumerate() {
            let topic = Topic::create(&domain, &contracts::journal(&graph, operator))?;
            journals.push(topic.subscriber(contracts::JOURNAL_DEPTH)?);
            topics.push(topic);
            let mut outputs = Vec::new();
            for (port, output) in node.stage.kind.outputs.iter().enumerate() {
                let contract = contracts::output(&graph, operator, port);
                let topic = Topic::create(&domain, &contract)?;
                outputs.push((topic.subscriber(contract.buffer)?, output.sample));
                topics.push(topic);
            }
            taps.push(outputs);
        }
        let mut children = Vec::new();
        for process in &graph.processes {
            let hello = Hello {
                process: process.name.clone(),
                source: source.clone(),
                root: folder.root(),
                prefix: folder.prefix().to_string(),
                clock: SessionClock::zero(),
                incarnations: vec![0; process.operators.len()],
                changes: vec![Vec::new(); process.operators.len()],
                directed: true,
            };
            children.push(Child::start(launch, launch.worker, &process.name, &hello)?);
        }
        let mut reported = Vec::new();
        wait_until_made(children.iter_mut(), &mut reported, || false)?;
        let mut workers: Vec<&mut Child> = children.iter_mut().collect();
        connect(&mut workers, 1, PATIENCE, &mut reported)?;
        let mut processes =
            Self { graph, children, journals, taps, _topics: topics, _domain: domain, _folder: folder };
        processes.connect()?;
        Ok(processes)
    }

    fn connect(&mut self) -> Result<(), stillpoint_shm::ShmError> {
        for journal in &self.journals {
            journal.connect()?;
        }
        for (tap, _) in self.taps.iter().flatten() {
            tap.connect()?;
        }
        Ok(())
    }

    fn ask(&mut self, operator: usize, order: &ToWorker) -> Result<FromWorker, PlacementError> {
        let node = &self.graph.operators[operator];
        let gone = |reason: String| PlacementError::Gone { operator: node.name.clone(), reason };
        let mut reported = Vec::new();
        let child = &mut self.children[node.process];
        child.send_message(order);
        match child.answer(PATIENCE, &mut reported) {
            Ok(FromWorker::Refused(reason)) => Err(gone(reason)),
            Ok(answer) => Ok(answer),
            other => Err(gone(first_reason(&reported, other))),
        }
    }

    fn gone(&self, operator: usize, reason: String) -> PlacementError {
        PlacementError::Gone { operator: self.graph.operators[operator].name.clone(), reason }
    }

    /// Takes the samples that were sent on these outputs, and has the consumers take them.
    fn pass_on(
        &mut self,
        operator: usize,
        sent: &[usize],
        outputs: &mut Vec<(usize, OwnedSample)>,
    ) -> Result<(), PlacementError> {
        for port in sent {
            let sample = self.taps[operator].get(*port).and_then(|(tap, kind)| {
                Some(OwnedSample::copy_of(kind, tap.receive().ok().flatten()?.pieces()))
            });
            outputs.extend(sample.map(|owned| (*port, owned)));
        }
        let graph = self.graph.clone();
        for port in sent.iter().collect::<BTreeSet<_>>() {
            for (consumer, input) in graph.consumers(operator, *port) {
                self.ask(consumer, &ToWorker::Take { operator: consumer, port: input })?;
            }
        }
        Ok(())
    }

    fn entry(&mut self, operator: usize) -> Result<Entry, PlacementError> {
        let received = self.journals[operator].receive();
        let entry = received.ok().flatten().and_then(|s| entry_of(s.pieces()));
        entry.ok_or_else(|| PlacementError::Gone {
            operator: self.graph.operators[operator].name.clone(),
            reason: "its journal entry did not arrive".to_string(),
        })
    }
}

fn first_reason(reported: &[ReportedFault], answer: Result<FromWorker, ChildError>) -> String {
    reported.first().map(|t| t.reason.clone()).unwrap_or_else(|| match answer {
        Ok(answer) => format!("an unexpected answer: {answer:?}"),
        Err(reason) => reason.to_string(),
    })
}

impl Placement for Processes {
    fn start(&mut self, operator: usize, begin: Begin) -> Result<Entry, PlacementError> {
        self.ask(operator, &ToWorker::Start { operator, begin })?;
        self.entry(operator)
    }

    fn activate(&mut self, operator: usize, record: &Record) -> Result<Committed, PlacementError> {
        let (mut fault, mut outputs, mut entry) = (None, Vec::new(), None);
        let mut order = ToWorker::Activate { operator, record: WireRecord::from(record) };
        loop {
            let FromWorker::Committed { sent, left, fault: message } = self.ask(operator, &order)? else {
                return Err(self.gone(operator, "an unexpected answer to an activation".to_string()));
            };
            if entry.is_none() {
                entry = Some(self.entry(operator)?);
                fault = message;
            }
            self.pass_on(operator, &sent, &mut outputs)?;
            if left == 0 {
                break;
            }
            order = ToWorker::More { operator };
        }
        let entry = entry.ok_or_else(|| self.gone(operator, "an activation without an entry".to_string()))?;
        let announced: u32 = entry.refs_of(RefKind::Output).map(|r| r.count).sum();
        if outputs.len() != announced as usize {
            let reason = format!("{} of {announced} samples of one activation arrived", outputs.len());
            return Err(self.gone(operator, reason));
        }
        Ok(Committed { entry, outputs, fault })
    }

    fn end(&mut self, operator: usize, time: u64, inputs: &[JournalRef]) -> Result<Entry, PlacementError> {
        self.ask(operator, &ToWorker::End { operator, time, inputs: wire_refs(inputs) })?;
        self.entry(operator)
    }
}

impl Drop for Processes {
    fn drop(&mut self) {
        for mut child in self.children.drain(..) {
            child.send_message(&ToWorker::Exit);
            child.reap(Duration::from_secs(5));
        }
    }
}
