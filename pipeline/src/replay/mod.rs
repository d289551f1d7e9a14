//! Replay: the journal's schedule. Every operator is run again from what it consumed, and what it sends is compared.
//!
//! Each operator is fed recorded samples, so that a difference is named where it arises and damage stays where it is.
//! By induction this equals the closed loop.
//!
//! - `difference`: which field of which sample differs, and by how much
//! - `journal`: the entries of all operators in the order of time, and their gaps

mod difference;
mod journal;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use serde::Serialize;
use stillpoint_recorder::{Session, SessionError};
use stillpoint_samples::{Cause, Entry, Outcome, RefKind};

pub use difference::Difference;
use journal::Ordered;

use crate::graph::Graph;
use crate::operator::Role;
use crate::placement::{Committed, Local, Placement, PlacementError};
use crate::record::Record;
use crate::schedule::Witness;
use crate::setup::Files;
use crate::shelf::Parcel;

/// Which operators are compared.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Selection {
    /// All of them.
    All,
    /// This one.
    Only(String),
    /// This one and all downstream of it.
    From(String),
}

/// How a replay went.
#[derive(Clone, Debug, Default, Serialize)]
pub struct ReplayReport {
    /// Activations that were done again.
    pub activations: u64,
    /// By topic: samples compared with the recording, and found the same.
    pub identical: BTreeMap<String, u64>,
    /// By topic: samples that the recording does not hold; they were made again.
    pub recomputed: BTreeMap<String, u64>,
    /// Samples that differ, or were made by no activation.
    pub differences: u64,
    /// The first of them.
    pub first_difference: Option<Difference>,
    /// Incarnations that could not be replayed to their end.
    pub open: Vec<Open>,
    /// Incarnations that were replayed from begin to end.
    pub exact_incarnations: u64,
    /// Session time between the first and the last entry, s.
    pub seconds: f64,
}

/// An incarnation that cannot be replayed from some activation on.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Open {
    /// Name of the operator.
    pub operator: String,
    /// Its incarnation.
    pub incarnation: u32,
    /// The first activation that is not exact.
    pub from_activation: u64,
    /// What is missing.
    pub reason: String,
}

/// Why a session cannot be replayed at all.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The session cannot be read.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// An operator cannot be made or run.
    #[error(transparent)]
    Placement(#[from] PlacementError),
    /// The selection names no operator.
    #[error("the pipeline has no operator `{0}`; it has {1}")]
    Operator(String, String),
    /// What was made again cannot be written.
    #[error("{0}")]
    Witness(String),
}

impl ReplayReport {
    /// Samples compared with the recording, and found the same.
    pub fn compared(&self) -> u64 {
        self.identical.values().sum()
    }

    /// Whether everything that could be compared is the same, and everything could be replayed.
    pub fn is_identical(&self) -> bool {
        self.differences == 0 && self.open.is_empty()
    }
}

/// Replays a session of this graph. `witness` sees every entry with the outputs as they were made again.
pub fn replay(
    session: &Session,
    graph: &Arc<Graph>,
    files: &dyn Files,
    selection: &Selection,
    witness: &mut dyn Witness,
) -> Result<ReplayReport, ReplayError> {
    let compared = selected(graph, selection)?;
    let run = needed(session, graph, &compared);
    let ordered = Ordered::new(session, graph);
    let mut replayer = Replayer {
        session,
        graph: graph.clone(),
        placement: Local::new(graph.clone(), files),
        lives: graph.operators.iter().map(|_| None).collect(),
        compared,
        run,
        report: ReplayReport::default(),
    };
    replayer.report.seconds = ordered.seconds();
    for (operator, entry, gap) in ordered.entries() {
        replayer.enter(operator, entry, gap, witness)?;
    }
    replayer.report.exact_incarnations +=
        replayer.lives.iter().flatten().filter(|l| l.open.is_none()).count() as u64;
    Ok(replayer.report)
}

/// Numbers of the operators that the selection names.
fn selected(graph: &Graph, selection: &Selection) -> Result<BTreeSet<usize>, ReplayError> {
    let find = |name: &str| {
        graph.operator(name).ok_or_else(|| {
            let all: Vec<_> = graph.operators.iter().map(|o| o.name.as_str()).collect();
            ReplayError::Operator(name.to_string(), all.join(", "))
        })
    };
    match selection {
        Selection::All => Ok((0..graph.operators.len()).collect()),
        Selection::Only(name) => Ok(BTreeSet::from([find(name)?])),
        Selection::From(name) => {
            let (mut found, mut todo) = (BTreeSet::new(), vec![find(name)?]);
            while let Some(operator) = todo.pop() {
                if found.insert(operator) {
                    for port in 0..graph.operators[operator].outputs.len() {
                        todo.extend(graph.consumers(operator, port).map(|(c, _)| c));
                    }
                }
            }
            Ok(found)
        }
    }
}

/// The operators that must run: those compared, and those that make what the recording does not hold for them.
fn needed(session: &Session, graph: &Graph, compared: &BTreeSet<usize>) -> BTreeSet<usize> {
    let (mut found, mut todo) = (BTreeSet::new(), compared.iter().copied().collect::<Vec<_>>());
    while let Some(operator) = todo.pop() {
        if graph.operators[operator].stage.kind.role == Role::Source || !found.insert(operator) {
            continue;
        }
        for edge in graph.operators[operator].inputs.iter().filter_map(|i| i.edge) {
            let topic = &graph.operators[edge.operator].outputs[edge.output].topic;
            if session.topic_number(topic).is_none() {
                todo.push(edge.operator);
            }
        }
    }
    found
}

struct Life {
    incarnation: u32,
    open: Option<u64>,
}

struct Replayer<'s, 'f> {
    session: &'s Session,
    graph: Arc<Graph>,
    placement: Local<'f>,
    lives: Vec<Option<Life>>,
    compared: BTreeSet<usize>,
    run: BTreeSet<usize>,
    report: ReplayReport,
}

impl Replayer<'_, '_> {
    fn enter(
        &mut self,
        operator: usize,
        entry: &Entry,
        gap: Option<String>,
        witness: &mut dyn Witness,
    ) -> Result<(), ReplayError> {
        let mut made = None;
        if self.run.contains(&operator) {
            if let Some(reason) = gap {
                self.open(operator, entry, reason);
            }
            match entry.cause() {
                Some(Cause::Start) => self.begin(operator, entry)?,
                Some(Cause::End) => self.finish(operator, entry)?,
                _ => made = self.activate(operator, entry)?,
            }
        }
        let made = made.unwrap_or_default();
        let outputs = self.hand_on(operator, entry, made)?;
        witness.saw(operator, entry, &outputs).map_err(ReplayError::Witness)
    }

    fn begin(&mut self, operator: usize, entry: &Entry) -> Result<(), ReplayError> {
        let life = Life { incarnation: entry.head.incarnation, open: None };
        if self.lives[operator].replace(life).is_some_and(|l| l.open.is_none()) {
            self.report.exact_incarnations += 1;
        }
        self.placement.start(operator, entry.head.incarnation, entry.head.stamp)?;
        Ok(())
    }

    fn finish(&mut self, operator: usize, entry: &Entry) -> Result<(), ReplayError> {
        if self.is_exact(operator, entry) {
            let again = self.placement.end(operator, entry.head.stamp, &[])?;
            self.compare_entries(operator, entry, &again);
        }
        Ok(())
    }

    fn is_exact(&self, operator: usize, entry: &Entry) -> bool {
        let life = self.lives[operator].as_ref();
        life.is_some_and(|l| l.incarnation == entry.head.incarnation && l.open.is_none())
    }

    /// From here to its end the incarnation is not exact.
    fn open(&mut self, operator: usize, entry: &Entry, reason: String) {
        let incarnation = entry.head.incarnation;
        match &mut self.lives[operator] {
            Some(life) if life.incarnation == incarnation => {
                if life.open.is_some() {
                    return;
                }
                life.open = Some(entry.body.index);
            }
            slot => {
                if slot.as_ref().is_some_and(|l| l.open.is_none()) {
                    self.report.exact_incarnations += 1;
                }
                *slot = Some(Life { incarnation, open: Some(entry.body.index) });
            }
        }
        self.report.open.push(Open {
            operator: self.graph.operators[operator].name.clone(),
            incarnation,
            from_activation: entry.body.index,
            reason,
        });
    }

    /// Does an activation again and compares its outputs. `None` where the incarnation is open.
    fn activate(
        &mut self,
        operator: usize,
        entry: &Entry,
    ) -> Result<Option<Vec<(usize, Parcel)>>, ReplayError> {
        if !self.is_exact(operator, entry) {
            return Ok(None);
        }
        let Some(record) = Record::of(entry) else { return Ok(None) };
        let committed = match self.placement.activate_alone(operator, &record) {
            Ok(committed) => committed,
            Err(PlacementError::Sample { port, incarnation, sequence, .. }) => {
                let node = &self.graph.operators[operator];
                let topic =
                    node.inputs.get(port as usize).and_then(|i| i.edge).map_or_else(String::new, |e| {
                        self.graph.operators[e.operator].outputs[e.output].topic.clone()
                    });
                let reason = format!(
                    "sample {sequence} of incarnation {incarnation} on {topic} is not in the session, and cannot be \
                     made again"
                );
                self.open(operator, entry, reason);
                return Ok(None);
            }
            Err(e) => return Err(e.into()),
        };
        self.report.activations += 1;
        self.compare(operator, entry, &committed)?;
        Ok(Some(committed.outputs))
    }

    fn compare(&mut self, operator: usize, entry: &Entry, again: &Committed) -> Result<(), ReplayError> {
        if !self.compared.contains(&operator) {
            return Ok(());
        }
        self.compare_entries(operator, entry, &again.entry);
        for (port, parcel) in &again.outputs {
            let topic = self.graph.operators[operator].outputs[*port].topic.clone();
            let head = parcel.head();
            let recorded = match self.session.topic_number(&topic) {
                Some(number) => self.session.sample(number, head.incarnation, head.sequence)?,
                None => None,
            };
            let Some(recorded) = recorded else {
                *self.report.recomputed.entry(topic).or_insert(0) += 1;
                continue;
            };
            if *recorded.sample == **parcel.bytes {
                *self.report.identical.entry(topic).or_insert(0) += 1;
            } else {
                let place = difference::Place {
                    operator: &self.graph.operators[operator].name,
                    entry,
                    topic: &topic,
                };
                let found = Difference::of_samples(&place, parcel.kind, &recorded.sample, &parcel.bytes);
                self.differ(found);
            }
        }
        Ok(())
    }

    /// Compares what two entries say of outcome and outputs.
    fn compare_entries(&mut self, operator: usize, recorded: &Entry, again: &Entry) {
        if !self.compared.contains(&operator) {
            return;
        }
        let name = &self.graph.operators[operator].name;
        let topic = crate::live::contracts::journal_topic(name);
        let place = difference::Place { operator: name, entry: recorded, topic: &topic };
        if let Some(found) = Difference::of_entries(&place, recorded, again) {
            self.differ(found);
        }
    }

    fn differ(&mut self, difference: Difference) {
        self.report.differences += 1;
        self.report.first_difference.get_or_insert(difference);
    }

    /// Gives the outputs of an entry to their consumers: as recorded where they are there, else as made again.
    fn hand_on(
        &mut self,
        operator: usize,
        entry: &Entry,
        made: Vec<(usize, Parcel)>,
    ) -> Result<Vec<(usize, Parcel)>, ReplayError> {
        if !made.is_empty() || entry.outcome() != Some(Outcome::Done) {
            for (port, parcel) in &made {
                let recorded =
                    self.recorded(operator, *port, entry.head.incarnation, parcel.head().sequence)?;
                self.placement.deliver(operator, *port, &recorded.unwrap_or_else(|| parcel.clone()));
            }
            return Ok(made);
        }
        let mut outputs = Vec::new();
        for r in entry.refs_of(RefKind::Output) {
            for sequence in r.first..r.first + u64::from(r.count) {
                if let Some(parcel) =
                    self.recorded(operator, r.port as usize, entry.head.incarnation, sequence)?
                {
                    self.placement.deliver(operator, r.port as usize, &parcel);
                    outputs.push((r.port as usize, parcel));
                }
            }
        }
        Ok(outputs)
    }

    fn recorded(
        &self,
        operator: usize,
        port: usize,
        incarnation: u32,
        sequence: u64,
    ) -> Result<Option<Parcel>, ReplayError> {
        let node = &self.graph.operators[operator];
        let (Some(output), Some(kind)) = (node.outputs.get(port), node.stage.kind.outputs.get(port)) else {
            return Ok(None);
        };
        let Some(number) = self.session.topic_number(&output.topic) else { return Ok(None) };
        let recorded = self.session.sample(number, incarnation, sequence)?;
        Ok(recorded.map(|r| Parcel { kind: kind.sample, bytes: Arc::new(r.sample) }))
    }
}
