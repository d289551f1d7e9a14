//! A thread per operator. Samples are shared by reference count; nothing else is.

use std::sync::Arc;
use std::thread::JoinHandle;

use crossbeam_channel::{Receiver, Sender, bounded, unbounded};
use stillpoint_samples::{Entry, JournalRef};

use super::{Begin, Committed, Directed, Placement, PlacementError};
use crate::graph::Graph;
use crate::limits::start_thread;
use crate::operator::Files;
use crate::record::Record;
use crate::sample_store::OwnedSample;

enum Ask {
    Start(Begin),
    Deliver { port: usize, owned: OwnedSample },
    Activate(Record),
    End { time: u64, inputs: Vec<JournalRef> },
}

enum Answer {
    Entry(Result<Entry, PlacementError>),
    Committed(Box<Result<Committed, PlacementError>>),
}

struct Worker {
    ask: Sender<Ask>,
    answer: Receiver<Answer>,
    _thread: JoinHandle<()>,
}

/// A thread per operator.
pub struct Threads {
    graph: Arc<Graph>,
    workers: Vec<Worker>,
}

impl Threads {
    /// Starts a thread per operator of a graph.
    pub fn new(graph: Arc<Graph>, files: &Arc<dyn Files + Send + Sync>) -> Result<Self, PlacementError> {
        let workers = (0..graph.operators.len())
            .map(|operator| {
                let (ask, asked) = unbounded();
                let (reply, answer) = bounded(1);
                let graph = graph.clone();
                let files = files.clone();
                let name = graph.operators[operator].name.clone();
                let thread =
                    start_thread(move || serve(Directed::new(graph, operator), &asked, &reply, &*files))
                        .map_err(|e| PlacementError::Gone {
                            operator: name,
                            reason: format!("its thread cannot be started: {e}"),
                        })?;
                Ok(Worker { ask, answer, _thread: thread })
            })
            .collect::<Result<_, _>>()?;
        Ok(Self { graph, workers })
    }

    fn gone(&self, operator: usize) -> PlacementError {
        PlacementError::Gone {
            operator: self.graph.operators[operator].name.clone(),
            reason: "its thread has ended".to_string(),
        }
    }

    fn ask_for_entry(&self, operator: usize, ask: Ask) -> Result<Entry, PlacementError> {
        let worker = &self.workers[operator];
        worker.ask.send(ask).map_err(|_| self.gone(operator))?;
        match worker.answer.recv() {
            Ok(Answer::Entry(entry)) => entry,
            _ => Err(self.gone(operator)),
        }
    }
}

fn serve(mut directed: Directed, asked: &Receiver<Ask>, reply: &Sender<Answer>, files: &dyn Files) {
    for ask in asked {
        let answer = match ask {
            Ask::Start(begin) => Answer::Entry(directed.start(begin, files)),
            Ask::Activate(record) => Answer::Committed(Box::new(directed.activate(&record))),
            Ask::End { time, inputs } => Answer::Entry(directed.end(time, &inputs)),
            Ask::Deliver { port, owned } => {
                directed.deliver(port, owned);
                continue;
            }
        };
        if reply.send(answer).is_err() {
            return;
        }
    }
}

impl Placement for Threads {
    fn start(&mut self, operator: usize, begin: Begin) -> Result<Entry, PlacementError> {
        self.ask_for_entry(operator, Ask::Start(begin))
    }

    fn activate(&mut self, operator: usize, record: &Record) -> Result<Committed, PlacementError> {
        let worker = &self.workers[operator];
        worker.ask.send(Ask::Activate(record.clone())).map_err(|_| self.gone(operator))?;
        let committed = match worker.answer.recv() {
            Ok(Answer::Committed(committed)) => (*committed)?,
            _ => return Err(self.gone(operator)),
        };
        for (output, owned) in &committed.outputs {
            for (consumer, port) in self.graph.consumers(operator, *output) {
                let deliver = Ask::Deliver { port, owned: owned.clone() };
                self.workers[consumer].ask.send(deliver).map_err(|_| self.gone(consumer))?;
            }
        }
        Ok(committed)
    }

    fn end(&mut self, operator: usize, time: u64, inputs: &[JournalRef]) -> Result<Entry, PlacementError> {
        self.ask_for_entry(operator, Ask::End { time, inputs: inputs.to_vec() })
    }
}
