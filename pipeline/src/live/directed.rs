//! A worker whose activations are decided by the supervisor (lock-step).

use std::collections::VecDeque;
use std::sync::Arc;

use stillpoint_samples::Entry;
use stillpoint_shm::{Domain, ShmError};

use super::control::{Connect, FromWorker, ToWorker, refs_of_wire};
use super::error::WorkerError;
use super::journal::{PublishError, publish_entry};
use super::pipe::{PipeReader, send_message, wait_for};
use super::ports::{Depth, Outlet, Ports};
use crate::graph::{Graph, ProcessNode};
use crate::operator::Files;
use crate::placement::Directed;
use crate::sample_store::OwnedSample;

/// The operators of a directed process.
pub struct DirectedWorker<'f> {
    runners: Vec<DirectedOperator>,
    files: &'f dyn Files,
}

struct DirectedOperator {
    number: usize,
    directed: Directed,
    ports: Ports,
    /// Outputs of the activation that is under way, for which there was no room yet.
    unsent: VecDeque<(usize, OwnedSample)>,
}

impl<'f> DirectedWorker<'f> {
    /// Makes the ports of the process.
    pub fn open(
        graph: Arc<Graph>,
        process: &ProcessNode,
        domain: &Domain,
        files: &'f dyn Files,
    ) -> Result<Self, WorkerError> {
        let runners = process.operators.iter().map(|o| DirectedOperator::open(&graph, *o, domain));
        Ok(Self { runners: runners.collect::<Result<_, _>>()?, files })
    }

    /// Obeys orders until the supervisor ends it.
    pub fn serve(&mut self, orders: &mut PipeReader) -> Result<(), WorkerError> {
        send_message(&FromWorker::Made)?;
        loop {
            let Some(order) = wait_for::<ToWorker>(orders)? else { return Ok(()) };
            match order {
                ToWorker::Exit => return Ok(()),
                ToWorker::Go { .. } => {}
                ToWorker::Connect(Connect { number }) => {
                    for runner in &self.runners {
                        runner.ports.connect()?;
                    }
                    send_message(&FromWorker::Connected { number })?;
                }
                ToWorker::Stop => send_message(&FromWorker::Stopped)?,
                order => {
                    let answer = self.obey(order).unwrap_or_else(|e| FromWorker::Refused(e.to_string()));
                    send_message(&answer)?;
                }
            }
        }
    }

    fn obey(&mut self, order: ToWorker) -> Result<FromWorker, WorkerError> {
        let files = self.files;
        match order {
            ToWorker::Start { operator, begin } => {
                let runner = self.runner(operator)?;
                let entry = runner.directed.start(begin, files)?;
                runner.publish_entry(&entry)?;
                Ok(FromWorker::Entry)
            }
            ToWorker::Take { operator, port } => {
                self.runner(operator)?.take(port)?;
                Ok(FromWorker::Taken)
            }
            ToWorker::Activate { operator, record } => {
                let runner = self.runner(operator)?;
                let record = record.record().ok_or(WorkerError::Record)?;
                let committed = runner.directed.activate(&record)?;
                runner.publish_entry(&committed.entry)?;
                runner.unsent = committed.outputs.into();
                let sent = runner.send()?;
                Ok(FromWorker::Committed { sent, left: runner.unsent.len(), fault: committed.fault })
            }
            ToWorker::More { operator } => {
                let runner = self.runner(operator)?;
                let sent = runner.send()?;
                Ok(FromWorker::Committed { sent, left: runner.unsent.len(), fault: None })
            }
            ToWorker::End { operator, time, inputs } => {
                let runner = self.runner(operator)?;
                let inputs = refs_of_wire(&inputs).ok_or(WorkerError::Account)?;
                let entry = runner.directed.end(time, &inputs)?;
                runner.publish_entry(&entry)?;
                Ok(FromWorker::Entry)
            }
            other => Err(WorkerError::Directed(format!("{other:?}"))),
        }
    }

    fn runner(&mut self, operator: usize) -> Result<&mut DirectedOperator, WorkerError> {
        self.runners.iter_mut().find(|m| m.number == operator).ok_or(WorkerError::NotHere(operator))
    }
}

impl DirectedOperator {
    fn open(graph: &Arc<Graph>, number: usize, domain: &Domain) -> Result<Self, ShmError> {
        let ports = Ports::open(graph, number, domain, Depth::OfTopic)?;
        Ok(Self { number, directed: Directed::new(graph.clone(), number), ports, unsent: VecDeque::new() })
    }

    fn take(&mut self, port: usize) -> Result<(), WorkerError> {
        let Some(Some(inlet)) = self.ports.inlets.get(port) else {
            return Err(WorkerError::NotConnected(port));
        };
        while let Some(sample) = inlet.subscriber.receive()? {
            self.directed.deliver(port, OwnedSample::copy_of(inlet.kind, sample.pieces()));
        }
        Ok(())
    }

    /// Sends outputs until the buffer of one is full; all consumers take those before the next are sent.
    fn send(&mut self) -> Result<Vec<usize>, WorkerError> {
        let mut sent = Vec::new();
        while let Some((port, owned)) = self.unsent.front() {
            let (port, pieces) = (*port, owned.pieces());
            let Outlet { publisher, topic } = &self.ports.outlets[port];
            if sent.iter().filter(|p| **p == port).count() >= topic.contract().buffer {
                break;
            }
            let loan = publisher.loan(owned.header().count as usize)?;
            let mut loan = loan.ok_or(WorkerError::OutputFull)?;
            let (meta, payload) = loan.parts_mut();
            meta.copy_from_slice(pieces.meta);
            payload[..pieces.payload.len()].copy_from_slice(pieces.payload);
            publisher.send(loan)?;
            sent.push(port);
            self.unsent.pop_front();
        }
        Ok(sent)
    }

    fn publish_entry(&mut self, entry: &Entry) -> Result<(), PublishError> {
        publish_entry(&self.ports.journal, entry)
    }
}
