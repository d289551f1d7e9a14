//! Discrete events, ordered by (time, place in the graph). Delays are those that the config declares, latencies too
//! unless a session measured others.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use stillpoint_samples::{Cause, Entry, Header, Outcome};

use super::decision::{Decision, Ticks, decide};
use super::fed::{Fed, Feed, Unfed};
use super::latencies::Latencies;
use super::waiting::Waiting;
use crate::finished::Finished;
use crate::graph::Graph;
use crate::intake::Intake;
use crate::placement::{Begin, Carried, Placement, PlacementError};
use crate::record::Record;
use crate::restarts::{Answer, Restarts};
use crate::sample_store::OwnedSample;

/// How long what is under way at the end is drained at most, ns of session time.
const DRAIN: u64 = 1_000_000_000;

/// Why a run ended before its time.
#[derive(Clone, Debug, thiserror::Error)]
pub enum RunError {
    /// An operator failed, and the restart policy of its process has the run end.
    #[error("operator {operator}: {message}; {reason}")]
    Fault {
        /// Name of the operator.
        operator: String,
        /// What it said last.
        message: String,
        /// What the policy says.
        reason: String,
    },
    /// An operator could not be made: nothing has happened.
    #[error("{0}")]
    NotBegun(PlacementError),
    /// The placement could not do what was asked.
    #[error(transparent)]
    Placement(#[from] PlacementError),
    /// The observer ended it.
    #[error(transparent)]
    Observer(#[from] ObserverError),
    /// Somebody stopped it.
    #[error("stopped")]
    Stopped,
}

/// Why an observer ends a run.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ObserverError {
    /// It cannot keep what it saw.
    #[error("{0}")]
    Failed(String),
    /// It has seen all that it needs.
    #[error("{0}")]
    Enough(String),
}

/// Sees everything that happens, in order: a recorder, a test, a summary.
pub trait Observer {
    /// An entry was made, with these outputs. Says why the run cannot go on, if it cannot.
    fn on_activation(
        &mut self,
        operator: usize,
        entry: &Entry,
        outputs: &[(usize, OwnedSample)],
    ) -> Result<(), ObserverError>;

    /// The activation that was seen last failed, and this is what the operator said.
    fn failed(&mut self, _operator: usize, _reason: &str) {}
}

/// The schedule of a simulated or lock-step run.
pub struct Events {
    graph: Arc<Graph>,
    operators: Vec<State>,
    /// By process.
    restarts: Vec<Restarts>,
    finished: Finished,
    /// When timers stop, ns.
    end: u64,
    /// Set by whoever wants the run to end.
    stop: Arc<AtomicBool>,
    latencies: Latencies,
}

struct State {
    /// Whether its activations are decided here; those of the others are fed.
    is_decided: bool,
    intake: Intake<Header>,
    ports: Vec<Waiting>,
    ticks: Option<Ticks>,
    busy_until: u64,
    /// Something has arrived, or was consumed, since the intake last said that nothing is ready.
    dirty: bool,
    incarnation: u32,
    down: Option<Down>,
}

/// Why an operator does nothing, and until when, ns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Down {
    /// It panicked: its ports are there, and samples wait.
    Panicked(u64),
    /// Its process died: what is sent meanwhile is not for it.
    Dead(u64),
}

impl Down {
    fn until(self) -> u64 {
        let (Self::Panicked(at) | Self::Dead(at)) = self;
        at
    }
}

impl Events {
    /// The schedule of a graph.
    pub fn new(graph: Arc<Graph>) -> Self {
        let operators = graph
            .operators
            .iter()
            .map(|node| State {
                is_decided: true,
                intake: Intake::new(node),
                ports: node.inputs.iter().map(|i| Waiting::of(i.policy)).collect(),
                ticks: None,
                busy_until: 0,
                dirty: true,
                incarnation: 0,
                down: None,
            })
            .collect();
        let restarts = graph.processes.iter().map(|p| Restarts::new(p.restart)).collect();
        let stop = Arc::default();
        let latencies = Latencies::default();
        Self { finished: Finished::new(&graph), graph, operators, restarts, end: 0, stop, latencies }
    }

    /// The same for a run that decides the activations of these operators alone.
    pub fn deciding(mut self, which: &BTreeSet<usize>) -> Self {
        for (operator, state) in self.operators.iter_mut().enumerate() {
            state.is_decided = which.contains(&operator);
        }
        self
    }

    /// The same for steps that take these times.
    pub fn taking(self, latencies: Latencies) -> Self {
        Self { latencies, ..self }
    }

    /// The same for a run that ends once `stop` is set: timers stop then. Set again, it ends the drain, too.
    pub fn stopped_by(self, stop: Arc<AtomicBool>) -> Self {
        Self { stop, ..self }
    }

    /// When timers stopped, ns of session time.
    pub fn end(&self) -> u64 {
        self.end
    }

    /// Runs from `start` for `duration`, both ns of session time, or until all that feeds the run has finished. Then
    /// timers stop, and what is still under way is drained, for at most a second of session time.
    pub fn run(
        &mut self,
        placement: &mut dyn Placement,
        start: u64,
        duration: u64,
        observer: &mut dyn Observer,
    ) -> Result<(), RunError> {
        self.run_fed(&mut Unfed(placement), start, duration, observer)
    }

    /// The same with the activations of a feed among those that are decided here. After the end of the run, what is left
    /// of the feed still comes.
    pub fn run_fed(
        &mut self,
        feed: &mut impl Feed,
        start: u64,
        duration: u64,
        observer: &mut dyn Observer,
    ) -> Result<(), RunError> {
        self.end = start.saturating_add(duration);
        self.begin(feed, start, observer)?;
        let mut last = start;
        let (mut ended, mut is_over) = (Ok(()), false);
        loop {
            let drained = self.end.saturating_add(DRAIN);
            let decided = self.next().filter(|(time, _)| !is_over && *time < drained);
            let fed = feed.next();
            let Some((time, operator)) = decided.into_iter().chain(fed).min() else { break };
            if self.stop.swap(false, Ordering::Relaxed) {
                if ended.is_err() {
                    break;
                }
                ended = Err(RunError::Stopped);
                self.end = self.end.min(time);
                continue;
            }
            last = last.max(time);
            if fed == Some((time, operator)) {
                if let Some(fed) = feed.take()? {
                    self.take_fed(operator, time, &fed, observer)?;
                }
                continue;
            }
            if let Err(e) = self.visit(operator, time, feed, observer) {
                self.end = self.end.min(last);
                // A fault ends the run in order.
                if !matches!(e, RunError::Fault { .. }) {
                    return Err(e);
                }
                ended = Err(e);
                is_over = true;
            }
        }
        last = last.max(feed.ended().unwrap_or(0));
        for (operator, state) in self.operators.iter().enumerate() {
            if !state.is_decided {
                for fed in feed.take_end(operator)? {
                    observer.on_activation(operator, &fed.entry, &fed.outputs).map_err(RunError::Observer)?;
                }
                continue;
            }
            // The dead mark no end.
            if !matches!(state.down, Some(Down::Dead(_))) {
                let entry = feed.end(operator, last, &state.intake.account())?;
                observer.on_activation(operator, &entry, &[]).map_err(RunError::Observer)?;
            }
        }
        ended
    }

    /// The first incarnations begin.
    fn begin(
        &mut self,
        feed: &mut impl Feed,
        start: u64,
        observer: &mut dyn Observer,
    ) -> Result<(), RunError> {
        for (operator, state) in self.operators.iter_mut().enumerate() {
            if !state.is_decided {
                if let Some(fed) = feed.take_start(operator, start)? {
                    self.finished.enter(operator, &fed.entry);
                    observer.on_activation(operator, &fed.entry, &fed.outputs).map_err(RunError::Observer)?;
                }
                continue;
            }
            state.busy_until = start;
            let every = self.graph.operators[operator].every;
            state.ticks = every.map(|every| Ticks { epoch: start, every, next: 0 });
            let entry = feed
                .start(operator, Begin { incarnation: 0, time: start, carried: Carried::All })
                .map_err(RunError::NotBegun)?;
            observer.on_activation(operator, &entry, &[]).map_err(RunError::Observer)?;
        }
        Ok(())
    }

    /// The next operator that may have something to do, and when.
    fn next(&self) -> Option<(u64, usize)> {
        let decided = self.operators.iter().enumerate().filter(|(_, state)| state.is_decided);
        let candidates = decided.filter_map(|(index, state)| {
            if let Some(down) = state.down {
                return (down.until() < self.end).then_some((down.until(), index));
            }
            let timer = self.ticks(index).map(|ticks| ticks.due());
            let arrival = state.ports.iter().filter_map(Waiting::next_arrival).min();
            let visible = state.intake.next_visible().filter(|t| *t > state.busy_until);
            let dirty = state.dirty.then_some(state.busy_until);
            let earliest = [timer, arrival, visible, dirty].into_iter().flatten().min()?;
            Some((earliest.max(state.busy_until), index))
        });
        candidates.min()
    }

    /// The operator's timer, if its next tick is due before the end and the operator has not finished.
    fn ticks(&self, operator: usize) -> Option<&Ticks> {
        let ticks = self.operators[operator].ticks.as_ref();
        ticks.filter(|ticks| !self.finished.has(operator) && ticks.due() < self.end)
    }

    /// Does at most one activation of an operator at `time`.
    fn visit(
        &mut self,
        operator: usize,
        time: u64,
        placement: &mut dyn Placement,
        observer: &mut dyn Observer,
    ) -> Result<(), RunError> {
        if let Some(down) = self.operators[operator].down {
            return self.begin_restart(operator, down, time, placement, observer);
        }
        let ticks = self.ticks(operator).copied();
        let graph = self.graph.clone();
        let node = &graph.operators[operator];
        let state = &mut self.operators[operator];
        state.arrive(time);
        let ports = &mut state.ports;
        let ready = state.intake.ready(time, &mut |port| ports[port].take());
        let Some(decision) = decide(time, ready, ticks.as_ref()) else {
            state.dirty = false;
            state.busy_until = state.busy_until.max(time);
            return Ok(());
        };
        let Decision { cause, port, nominal, tick } = decision;
        if let Some(ticks) = state.ticks.as_mut().filter(|_| cause == Cause::Timer) {
            ticks.next = tick + 1;
        }
        state.dirty = true;
        // A change of a parameter is no step, and takes no time.
        let latency = if cause == Cause::Set { 0 } else { self.latencies.of(node, time) };
        if let Some(deadline) = node.deadline.filter(|deadline| latency > *deadline) {
            return self.die(operator, time.saturating_add(deadline), latency, observer);
        }
        let state = &mut self.operators[operator];
        let record = Record { time, nominal, tick, cause, port, inputs: state.intake.begin(cause, port) };
        let committed = placement.activate(operator, &record)?;
        state.intake.end();
        // At least one nanosecond, so that stamps of an operator rise.
        state.busy_until = time.saturating_add(latency.max(1));
        observer.on_activation(operator, &committed.entry, &committed.outputs).map_err(RunError::Observer)?;
        if let Some(reason) = &committed.fault {
            observer.failed(operator, reason);
        }
        self.enter(operator, time, &committed.entry);
        if committed.entry.outcome() == Some(Outcome::Panic) {
            let at = self.answer(operator, time, &committed.fault.unwrap_or_default())?;
            // At least one nanosecond, so that stamps of an operator rise.
            self.operators[operator].down = Some(Down::Panicked(at.max(time + 1)));
        }
        self.send(operator, time.saturating_add(latency), &committed.outputs);
        Ok(())
    }

    /// Takes what happened already.
    fn take_fed(
        &mut self,
        operator: usize,
        time: u64,
        fed: &Fed,
        observer: &mut dyn Observer,
    ) -> Result<(), RunError> {
        let latency = self.latencies.of(&self.graph.operators[operator], time);
        observer.on_activation(operator, &fed.entry, &fed.outputs).map_err(RunError::Observer)?;
        self.enter(operator, time, &fed.entry);
        self.send(operator, time.saturating_add(latency), &fed.outputs);
        Ok(())
    }

    /// The run is over where this entry says that the last that feeds it has finished.
    fn enter(&mut self, operator: usize, time: u64, entry: &Entry) {
        self.finished.enter(operator, entry);
        if entry.outcome() == Some(Outcome::Finished) && self.finished.is_all(&self.graph) {
            // What is due now still happens.
            self.end = self.end.min(time.saturating_add(1));
        }
    }

    /// Sends outputs on their way to the consumers whose activations are decided here.
    fn send(&mut self, operator: usize, arrival: u64, outputs: &[(usize, OwnedSample)]) {
        for (output, owned) in outputs {
            for (consumer, port) in self.graph.consumers(operator, *output) {
                let state = &mut self.operators[consumer];
                if state.is_decided {
                    state.ports[port].send(arrival, owned.header());
                }
            }
        }
    }

    /// When what failed at `time` begins again, or why the run ends.
    fn answer(&mut self, operator: usize, time: u64, message: &str) -> Result<u64, RunError> {
        let node = &self.graph.operators[operator];
        match self.restarts[node.process].failed(time) {
            Answer::RestartAt { at } => Ok(at),
            Answer::GiveUp(reason) => {
                Err(RunError::Fault { operator: node.name.clone(), message: message.to_string(), reason })
            }
        }
    }

    /// A step is not done by its deadline: its process dies, with all its operators, and nothing of the step is seen.
    fn die(
        &mut self,
        operator: usize,
        time: u64,
        latency: u64,
        observer: &mut dyn Observer,
    ) -> Result<(), RunError> {
        let graph = self.graph.clone();
        let node = &graph.operators[operator];
        let message = format!(
            "a step takes {} us, longer than its deadline of {} us",
            latency / 1000,
            node.deadline.unwrap_or(0) / 1000
        );
        observer.failed(operator, &message);
        let members = &graph.processes[node.process].operators;
        for member in members {
            self.operators[*member].down = Some(Down::Dead(u64::MAX));
        }
        let at = self.answer(operator, time, &message)?;
        for member in members {
            self.operators[*member].down = Some(Down::Dead(at));
        }
        Ok(())
    }

    /// A new incarnation begins.
    fn begin_restart(
        &mut self,
        operator: usize,
        down: Down,
        time: u64,
        placement: &mut dyn Placement,
        observer: &mut dyn Observer,
    ) -> Result<(), RunError> {
        let node = &self.graph.operators[operator];
        let state = &mut self.operators[operator];
        state.down = None;
        state.incarnation += 1;
        state.dirty = true;
        state.busy_until = time + 1;
        match down {
            Down::Panicked(_) => state.intake.renew(),
            Down::Dead(_) => {
                state.intake = Intake::new(node);
                state.ports.iter_mut().for_each(|port| port.forget_before(time));
                state.ticks = state.ticks.map(|ticks| Ticks::from(ticks.epoch, ticks.every, time));
            }
        }
        let entry = placement
            .start(operator, Begin { incarnation: state.incarnation, time, carried: Carried::All })?;
        self.finished.enter(operator, &entry);
        observer.on_activation(operator, &entry, &[]).map_err(RunError::Observer)
    }
}

impl State {
    /// Moves what has arrived by `time` to where the intake takes it.
    fn arrive(&mut self, time: u64) {
        for port in &mut self.ports {
            self.dirty |= port.arrive(time);
        }
    }
}
