//! Does activations again and compares what they send with the recording.

use std::collections::BTreeSet;
use std::sync::Arc;

use stillpoint_recorder::Session;
use stillpoint_samples::{Cause, Entry, Outcome, RefKind};

use super::difference::{self, Difference};
use super::{Open, ReplayError, ReplayReport};
use crate::graph::{Graph, OperatorNode};
use crate::operator::Files;
use crate::placement::{Begin, Carried, Local, Placement, PlacementError};
use crate::record::Record;
use crate::sample_store::OwnedSample;
use crate::schedule::Observer;

struct Life {
    incarnation: u32,
    open: Option<u64>,
}

/// Does the activations of a session again, and compares.
pub struct Replayer<'s, 'f> {
    session: &'s Session,
    graph: Arc<Graph>,
    placement: Local<'f>,
    files: &'f dyn Files,
    lives: Vec<Option<Life>>,
    compared: BTreeSet<usize>,
    run: BTreeSet<usize>,
    report: ReplayReport,
}

impl<'s, 'f> Replayer<'s, 'f> {
    /// Runs the operators in `run` again, and compares those in `compared`.
    pub fn new(
        session: &'s Session,
        graph: &Arc<Graph>,
        files: &'f dyn Files,
        compared: BTreeSet<usize>,
        run: BTreeSet<usize>,
    ) -> Self {
        Self {
            session,
            graph: graph.clone(),
            placement: Local::new(graph.clone(), files).serving(run.clone()),
            files,
            lives: graph.operators.iter().map(|_| None).collect(),
            compared,
            run,
            report: ReplayReport::default(),
        }
    }

    /// How it went.
    pub fn report(mut self) -> ReplayReport {
        self.report.exact_incarnations +=
            self.lives.iter().flatten().filter(|l| l.open.is_none()).count() as u64;
        self.report
    }

    /// Takes the next entry; `gap` says what is missing before it.
    pub fn enter(
        &mut self,
        operator: usize,
        entry: &Entry,
        gap: Option<String>,
        observer: &mut dyn Observer,
    ) -> Result<(), ReplayError> {
        let mut made = None;
        if self.run.contains(&operator) {
            match (gap, entry.cause()) {
                (Some(reason), _) => self.open(operator, entry, reason),
                (None, Some(Cause::Start)) => self.begin(operator, entry)?,
                (None, Some(Cause::End)) => self.finish(operator, entry),
                _ => made = self.activate(operator, entry)?,
            }
        }
        let made = made.unwrap_or_default();
        let outputs = self.hand_on(operator, entry, made)?;
        Ok(observer.on_activation(operator, entry, &outputs)?)
    }

    fn begin(&mut self, operator: usize, entry: &Entry) -> Result<(), ReplayError> {
        let open_already = |l: &Life| l.incarnation == entry.header.incarnation && l.open.is_some();
        if self.lives[operator].as_ref().is_some_and(open_already) {
            return Ok(());
        }
        let life = Life { incarnation: entry.header.incarnation, open: None };
        if self.lives[operator].replace(life).is_some_and(|l| l.open.is_none()) {
            self.report.exact_incarnations += 1;
        }
        match lacking(&self.graph.operators[operator], self.files) {
            Some(reason) => self.open(operator, entry, reason),
            None => {
                let begin = Begin {
                    incarnation: entry.header.incarnation,
                    time: entry.header.stamp,
                    carried: Carried::First(entry.body.tick),
                };
                match self.placement.start(operator, begin) {
                    Ok(_) => {}
                    Err(error @ PlacementError::Changes { .. }) => {
                        self.open(operator, entry, error.to_string())
                    }
                    // The recording shows that it could be made: a build that cannot is no gap of the session.
                    Err(error) => return Err(error.into()),
                }
            }
        }
        Ok(())
    }

    fn finish(&mut self, operator: usize, entry: &Entry) {
        if !self.is_exact(operator, entry) {
            return;
        }
        match self.placement.end(operator, entry.header.stamp, &[]) {
            Ok(rerun) => self.compare_entries(operator, entry, &rerun),
            Err(e) => self.open(operator, entry, e.to_string()),
        }
    }

    fn is_exact(&self, operator: usize, entry: &Entry) -> bool {
        let life = self.lives[operator].as_ref();
        life.is_some_and(|l| l.incarnation == entry.header.incarnation && l.open.is_none())
    }

    /// From here to its end the incarnation is not exact.
    fn open(&mut self, operator: usize, entry: &Entry, reason: String) {
        let incarnation = entry.header.incarnation;
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
    ) -> Result<Option<Vec<(usize, OwnedSample)>>, ReplayError> {
        if !self.is_exact(operator, entry) {
            return Ok(None);
        }
        let Some(record) = Record::of(entry) else { return Ok(None) };
        let committed = loop {
            match self.placement.activate_alone(operator, &record) {
                Ok(committed) => break committed,
                Err(PlacementError::Sample { port, incarnation, sequence, .. }) => {
                    if self.fetch(operator, port as usize, incarnation, sequence)? {
                        continue;
                    }
                    let topic = self.edge(operator, port as usize).map_or("", |(_, _, topic)| topic);
                    let reason = format!(
                        "sample {sequence} of incarnation {incarnation} on {topic} is not in the session, and cannot \
                         be made again"
                    );
                    self.open(operator, entry, reason);
                    return Ok(None);
                }
                // One bad entry harms one incarnation.
                Err(e) => {
                    self.open(operator, entry, e.to_string());
                    return Ok(None);
                }
            }
        };
        self.report.activations += 1;
        if self.compared.contains(&operator) {
            self.report.activations_compared += 1;
            self.compare_entries(operator, entry, &committed.entry);
        }
        for (port, owned) in &committed.outputs {
            let other = self.compare(operator, entry, *port, owned)?;
            self.placement.deliver(operator, *port, other.as_ref().unwrap_or(owned));
        }
        Ok(Some(committed.outputs))
    }

    /// Operator, output and topic that feed an input.
    fn edge(&self, operator: usize, port: usize) -> Option<(usize, usize, &str)> {
        let edge = self.graph.operators[operator].inputs.get(port)?.edge?;
        Some((edge.operator, edge.output, &self.graph.operators[edge.operator].outputs[edge.output].topic))
    }

    /// Hands a recorded sample to an operator that did not get it, since the entry that sent it is missing or stands
    /// elsewhere. Says whether it is there.
    fn fetch(
        &mut self,
        operator: usize,
        port: usize,
        incarnation: u32,
        sequence: u64,
    ) -> Result<bool, ReplayError> {
        let Some((producer, output, _)) = self.edge(operator, port) else { return Ok(false) };
        let Some(owned) = self.recorded(producer, output, incarnation, sequence)? else { return Ok(false) };
        self.placement.deliver_to(operator, port, owned);
        Ok(true)
    }

    /// Compares a sample that was made again with the recorded one, and gives that one where it is another.
    fn compare(
        &mut self,
        operator: usize,
        entry: &Entry,
        port: usize,
        owned: &OwnedSample,
    ) -> Result<Option<OwnedSample>, ReplayError> {
        let header = owned.header();
        let topic = &self.graph.operators[operator].outputs[port].topic;
        let same = match self.session.topic_number(topic) {
            Some(number) => self.session.holds(number, header.incarnation, header.sequence, &owned.bytes)?,
            None => None,
        };
        if self.compared.contains(&operator) {
            match same {
                None => *self.report.recomputed.entry(topic.clone()).or_insert(0) += 1,
                Some(true) => *self.report.identical.entry(topic.clone()).or_insert(0) += 1,
                Some(false) => {}
            }
        }
        if same != Some(false) {
            return Ok(None);
        }
        let recorded = self.recorded(operator, port, header.incarnation, header.sequence)?;
        if let Some(recorded) = recorded.as_ref().filter(|_| self.compared.contains(&operator)) {
            let place = difference::Place { operator: &self.graph.operators[operator].name, entry, topic };
            let found = Difference::of_samples(&place, owned.kind, &recorded.bytes, &owned.bytes);
            self.differ(found);
        }
        Ok(recorded)
    }

    /// Compares what two entries say of outcome and outputs.
    fn compare_entries(&mut self, operator: usize, recorded: &Entry, rerun: &Entry) {
        if !self.compared.contains(&operator) {
            return;
        }
        let name = &self.graph.operators[operator].name;
        let topic = crate::live::contracts::journal_topic(name);
        let place = difference::Place { operator: name, entry: recorded, topic: &topic };
        if let Some(found) = Difference::of_entries(&place, recorded, rerun) {
            self.differ(found);
        }
    }

    /// Counts a difference, and keeps the first.
    pub fn differ(&mut self, difference: Difference) {
        self.report.differences += 1;
        self.report.first_difference.get_or_insert(difference);
    }

    /// Gives the outputs of an entry that was not done again, or made nothing, to their consumers as they were recorded.
    /// Those that were made are handed on already: as recorded where they are there, else as made again.
    fn hand_on(
        &mut self,
        operator: usize,
        entry: &Entry,
        made: Vec<(usize, OwnedSample)>,
    ) -> Result<Vec<(usize, OwnedSample)>, ReplayError> {
        if !made.is_empty() || entry.outcome().is_none_or(Outcome::is_failure) {
            return Ok(made);
        }
        let mut outputs = Vec::new();
        for r in entry.refs_of(RefKind::Output) {
            for sequence in r.first..r.first + u64::from(r.count) {
                if let Some(owned) =
                    self.recorded(operator, r.port as usize, entry.header.incarnation, sequence)?
                {
                    self.placement.deliver(operator, r.port as usize, &owned);
                    outputs.push((r.port as usize, owned));
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
    ) -> Result<Option<OwnedSample>, ReplayError> {
        let node = &self.graph.operators[operator];
        let (Some(output), Some(kind)) = (node.outputs.get(port), node.stage.kind.outputs.get(port)) else {
            return Ok(None);
        };
        let Some(number) = self.session.topic_number(&output.topic) else { return Ok(None) };
        let recorded = self.session.sample(number, incarnation, sequence)?;
        Ok(recorded.map(|r| OwnedSample { kind: kind.sample, bytes: Arc::new(r.sample) }))
    }
}

/// The first file that an operator reads and that cannot be read, and why.
fn lacking(node: &OperatorNode, files: &dyn Files) -> Option<String> {
    node.files.iter().find_map(|name| {
        let names = match files.list(name) {
            Ok(names) => names,
            Err(e) => return Some(format!("it reads {name}: {e}")),
        };
        names.iter().find_map(|file| files.read(file).err().map(|e| format!("it reads {file}: {e}")))
    })
}
