//! The recorded part of a session, entry by entry, and the operators that run again beside it.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;

use stillpoint_recorder::Session;
use stillpoint_samples::{Cause, Entry, JournalRef, RefKind};

use crate::graph::Graph;
use crate::operator::{Files, Role};
use crate::placement::{Begin, Committed, Local, Placement, PlacementError};
use crate::record::Record;
use crate::replay::journal::Ordered;
use crate::replay::replayer::Replayer;
use crate::replay::selection::needed;
use crate::replay::{ReplayError, ReplayReport};
use crate::sample_store::OwnedSample;
use crate::schedule::{Fed, Feed, Observer, ObserverError, RunError};

/// An entry of the recording, in its place in time.
struct Due<'s> {
    time: u64,
    /// In the recorded graph.
    operator: usize,
    entry: &'s Entry,
    gap: Option<String>,
}

/// The recorded operators of a session, replayed as far as the recording does not hold what others consume of them; and
/// the operators that run again.
pub struct RecordedPart<'s, 'f> {
    replayer: Replayer<'s, 'f>,
    /// The operators that run again.
    placement: Local<'f>,
    /// By operator of the recorded graph: its number in the changed graph, if it is not run again.
    number: Vec<Option<usize>>,
    due: VecDeque<Due<'s>>,
    /// By operator of the changed graph: the entries that begin and end it.
    starts: BTreeMap<usize, Due<'s>>,
    ends: BTreeMap<usize, Due<'s>>,
    ended: Option<u64>,
}

/// Keeps the outputs of one entry.
#[derive(Default)]
struct Outputs(Vec<(usize, OwnedSample)>);

impl Observer for Outputs {
    fn on_activation(
        &mut self,
        _: usize,
        _: &Entry,
        outputs: &[(usize, OwnedSample)],
    ) -> Result<(), ObserverError> {
        self.0 = outputs.to_vec();
        Ok(())
    }
}

impl<'s, 'f> RecordedPart<'s, 'f> {
    /// The part of a session of the graph `old` that is not among the operators `decided` of the changed graph. The end
    /// of a session in session time is the same for all operators.
    pub fn new(
        session: &'s Session,
        old: &Arc<Graph>,
        files: &'f dyn Files,
        (graph, changed_files): (&Arc<Graph>, &'f dyn Files),
        decided: &BTreeSet<usize>,
        is_directed: bool,
    ) -> Self {
        let number: Vec<Option<usize>> = old
            .operators
            .iter()
            .map(|node| graph.operator(&node.name).filter(|number| !decided.contains(number)))
            .collect();
        let run = needed(session, old, &feeders(session, old, graph, &number, decided));
        let is_recorded = |operator: &usize| number[*operator].is_some();
        let mut due: VecDeque<Due<'s>> = Ordered::new(session, old)
            .timed()
            .filter(|(_, operator, ..)| is_recorded(operator) || run.contains(operator))
            .map(|(time, operator, entry, gap)| Due { time, operator, entry, gap })
            .collect();
        let last: BTreeMap<usize, (u32, u64)> =
            due.iter().map(|d| (d.operator, (d.entry.header.incarnation, d.entry.header.sequence))).collect();
        let (mut starts, mut ends, mut rest) = (BTreeMap::new(), BTreeMap::new(), VecDeque::new());
        for entry in due.drain(..) {
            let header = entry.entry.header;
            match (number[entry.operator], entry.entry.cause()) {
                (Some(new), Some(Cause::Start)) if header.incarnation == 0 && is_directed => {
                    starts.insert(new, entry);
                }
                (Some(new), Some(Cause::End))
                    if last.get(&entry.operator) == Some(&(header.incarnation, header.sequence)) =>
                {
                    ends.insert(new, entry);
                }
                _ => rest.push_back(entry),
            }
        }
        let ended = ends.values().map(|end| end.time).max().filter(|_| is_directed);
        let replayer = Replayer::new(session, old, files, run.clone(), run);
        let placement = Local::new(graph.clone(), changed_files).serving(decided.clone());
        Self { replayer, placement, number, due: rest, starts, ends, ended }
    }

    /// How the replayed part went.
    pub fn report(self) -> ReplayReport {
        self.replayer.report()
    }

    /// Takes an entry of the recording: gives it with its outputs, which have reached the operators that run again.
    fn enter(&mut self, due: Due<'s>) -> Result<Option<Fed>, RunError> {
        let mut outputs = Outputs::default();
        self.replayer.enter(due.operator, due.entry, due.gap, &mut outputs).map_err(|e| match e {
            ReplayError::Placement(e) => RunError::Placement(e),
            other => RunError::Observer(ObserverError::Failed(other.to_string())),
        })?;
        let Some(number) = self.number[due.operator] else { return Ok(None) };
        for (port, owned) in &outputs.0 {
            self.placement.deliver(number, *port, owned);
        }
        Ok(Some(Fed { entry: due.entry.clone(), outputs: outputs.0 }))
    }
}

impl Feed for RecordedPart<'_, '_> {
    fn next(&self) -> Option<(u64, usize)> {
        self.due.iter().find_map(|due| Some((due.time, self.number[due.operator]?)))
    }

    fn take(&mut self) -> Result<Option<Fed>, RunError> {
        // What the recording does not hold is made again on the way.
        while let Some(due) = self.due.pop_front() {
            if let Some(fed) = self.enter(due)? {
                return Ok(Some(fed));
            }
        }
        Ok(None)
    }

    fn take_start(&mut self, operator: usize, start: u64) -> Result<Option<Fed>, RunError> {
        match self.starts.remove(&operator) {
            None => Ok(None),
            Some(due) if due.time <= start => self.enter(due),
            Some(due) => {
                let place = self.due.partition_point(|d| (d.time, d.operator) < (due.time, due.operator));
                self.due.insert(place, due);
                Ok(None)
            }
        }
    }

    fn take_end(&mut self, operator: usize) -> Result<Vec<Fed>, RunError> {
        let Some(due) = self.ends.remove(&operator) else { return Ok(Vec::new()) };
        Ok(self.enter(due)?.into_iter().collect())
    }

    fn ended(&self) -> Option<u64> {
        self.ended
    }
}

impl Placement for RecordedPart<'_, '_> {
    fn start(&mut self, operator: usize, begin: Begin) -> Result<Entry, PlacementError> {
        self.placement.start(operator, begin)
    }

    fn activate(&mut self, operator: usize, record: &Record) -> Result<Committed, PlacementError> {
        self.placement.activate(operator, record)
    }

    fn end(&mut self, operator: usize, time: u64, inputs: &[JournalRef]) -> Result<Entry, PlacementError> {
        self.placement.end(operator, time, inputs)
    }
}

/// The recorded operators that have to run again, because an operator that is decided anew takes a topic of theirs that
/// the recording does not hold as a whole, or the session that is written keeps it.
fn feeders(
    session: &Session,
    old: &Graph,
    graph: &Graph,
    number: &[Option<usize>],
    decided: &BTreeSet<usize>,
) -> BTreeSet<usize> {
    let mut found = BTreeSet::new();
    for (operator, node) in old.operators.iter().enumerate() {
        let Some(new) = number[operator] else { continue };
        if node.stage.kind.role == Role::Source {
            continue;
        }
        let is_missing = (0..node.outputs.len()).any(|port| {
            let is_taken = graph.consumers(new, port).any(|(consumer, _)| decided.contains(&consumer));
            (is_taken || graph.is_recorded(new, port)) && !holds_all(session, old, operator, port)
        });
        if is_missing {
            found.insert(operator);
        }
    }
    found
}

/// Whether every sample that an operator's journal names is recorded.
fn holds_all(session: &Session, graph: &Graph, operator: usize, port: usize) -> bool {
    let node = &graph.operators[operator];
    let Some(topic) = session.topic_number(&node.outputs[port].topic) else { return false };
    let journal = session.journals().get(&node.name).into_iter().flatten();
    journal.flat_map(|entry| entry.refs_of(RefKind::Output).map(move |r| (entry, r))).all(|(entry, r)| {
        r.port as usize != port
            || (r.first..r.first.saturating_add(u64::from(r.count)))
                .all(|sequence| session.has(topic, entry.header.incarnation, sequence))
    })
}
