//! Discrete events, ordered by (time, place in the graph). Latencies and delays are those that the config declares.

use std::collections::VecDeque;
use std::sync::Arc;

use stillpoint_samples::{Cause, Entry, Head, Outcome};

use crate::graph::{Graph, Restart};
use crate::intake::Intake;
use crate::operator::Policy;
use crate::placement::{Placement, PlacementError};
use crate::record::Record;
use crate::shelf::Parcel;

/// Why a run ended before its time.
#[derive(Clone, Debug, thiserror::Error)]
pub enum RunError {
    /// An operator failed more often in a row than its policy allows.
    #[error(
        "operator {operator} failed {times} times in a row, which its restart policy does not allow: {reason}"
    )]
    Fault {
        /// Name of the operator.
        operator: String,
        /// Failures in a row.
        times: u32,
        /// What it said last.
        reason: String,
    },
    /// The placement could not do what was asked.
    #[error(transparent)]
    Placement(#[from] PlacementError),
    /// The witness could not keep what it saw.
    #[error("{0}")]
    Witness(String),
}

/// Sees everything that happens, in order: a recorder, a test, a summary.
pub trait Witness {
    /// An entry was made, with these outputs. Says why the run cannot go on, if it cannot.
    fn saw(&mut self, operator: usize, entry: &Entry, outputs: &[(usize, Parcel)]) -> Result<(), String>;
}

/// The schedule of a simulated or lock-step run.
pub struct Events {
    graph: Arc<Graph>,
    operators: Vec<State>,
}

struct State {
    intake: Intake<Head>,
    ports: Vec<Waiting>,
    /// Number of the next timer tick.
    tick: u64,
    busy_until: u64,
    /// Something has arrived, or was consumed, since the intake last said that nothing is ready.
    dirty: bool,
    incarnation: u32,
    panics: u32,
}

/// The samples on their way to one input.
struct Waiting {
    depth: usize,
    /// Sent, not arrived: (time of arrival, head).
    under_way: VecDeque<(u64, Head)>,
    arrived: VecDeque<Head>,
}

impl Events {
    /// The schedule of a graph.
    pub fn new(graph: Arc<Graph>) -> Self {
        let operators = graph
            .operators
            .iter()
            .map(|node| State {
                intake: Intake::new(node),
                ports: node.inputs.iter().map(|i| Waiting::of(i.policy)).collect(),
                tick: 0,
                busy_until: 0,
                dirty: true,
                incarnation: 0,
                panics: 0,
            })
            .collect();
        Self { graph, operators }
    }

    /// Runs from `start` for `duration`, both ns of session time. When the time is over timers stop, and what is still
    /// under way is drained, for at most a second of session time.
    pub fn run(
        &mut self,
        placement: &mut dyn Placement,
        start: u64,
        duration: u64,
        witness: &mut dyn Witness,
    ) -> Result<(), RunError> {
        let end = start.saturating_add(duration);
        for operator in 0..self.operators.len() {
            self.operators[operator].busy_until = start;
            let entry = placement.start(operator, 0, start)?;
            witness.saw(operator, &entry, &[]).map_err(RunError::Witness)?;
        }
        let mut last = start;
        while let Some((time, operator)) = self.next(start, end) {
            if time >= end.saturating_add(1_000_000_000) {
                break;
            }
            last = last.max(time);
            self.visit(operator, time, start, end, placement, witness)?;
        }
        for operator in 0..self.operators.len() {
            let account = self.operators[operator].intake.account();
            let entry = placement.end(operator, last, &account)?;
            witness.saw(operator, &entry, &[]).map_err(RunError::Witness)?;
        }
        Ok(())
    }

    /// The next operator that may have something to do, and when.
    fn next(&self, start: u64, end: u64) -> Option<(u64, usize)> {
        let candidates = self.operators.iter().enumerate().filter_map(|(index, state)| {
            let timer = self.timer(index, start, end);
            let arrival = state.ports.iter().filter_map(|p| p.under_way.front().map(|(t, _)| *t)).min();
            let visible = state.intake.next_visible().filter(|t| *t > state.busy_until);
            let dirty = state.dirty.then_some(state.busy_until);
            let earliest = [timer, arrival, visible, dirty].into_iter().flatten().min()?;
            Some((earliest.max(state.busy_until), index))
        });
        candidates.min()
    }

    /// When the operator's timer is due, if it is before the end.
    fn timer(&self, operator: usize, start: u64, end: u64) -> Option<u64> {
        let every = self.graph.operators[operator].every?;
        let due = start.saturating_add(self.operators[operator].tick.saturating_mul(every));
        (due < end).then_some(due)
    }

    /// Does at most one activation of an operator at `time`.
    fn visit(
        &mut self,
        operator: usize,
        time: u64,
        start: u64,
        end: u64,
        placement: &mut dyn Placement,
        witness: &mut dyn Witness,
    ) -> Result<(), RunError> {
        let timer = self.timer(operator, start, end).filter(|due| *due <= time);
        let graph = self.graph.clone();
        let node = &graph.operators[operator];
        let state = &mut self.operators[operator];
        state.arrive(time);
        let ports = &mut state.ports;
        let ready = state.intake.ready(time, &mut |port| ports[port].arrived.pop_front());
        // What came before the tick is seen before it; at the same time, too.
        let input = ready.filter(|trigger| timer.is_none_or(|due| trigger.since <= due));
        let (cause, port, nominal, tick) = match (input, timer) {
            (Some(trigger), _) => (trigger.cause, trigger.port, time, 0),
            (None, Some(due)) => {
                state.tick += 1;
                (Cause::Timer, 0, due, state.tick - 1)
            }
            (None, None) => {
                state.dirty = false;
                state.busy_until = state.busy_until.max(time);
                return Ok(());
            }
        };
        state.dirty = true;
        let record = Record { time, nominal, tick, cause, port, inputs: state.intake.begin(cause, port) };
        let committed = placement.activate(operator, &record)?;
        state.intake.end();
        // At least one nanosecond, so that stamps of an operator rise.
        state.busy_until = time.saturating_add(node.latency.max(1));
        witness.saw(operator, &committed.entry, &committed.outputs).map_err(RunError::Witness)?;
        if committed.entry.outcome() == Some(Outcome::Panic) {
            self.reincarnate(operator, time, &committed.fault.unwrap_or_default(), placement, witness)?;
        } else {
            self.operators[operator].panics = 0;
        }
        for (output, parcel) in &committed.outputs {
            for (consumer, port) in graph.consumers(operator, *output) {
                let arrival = time.saturating_add(node.latency);
                self.operators[consumer].ports[port].under_way.push_back((arrival, parcel.head()));
            }
        }
        Ok(())
    }

    fn reincarnate(
        &mut self,
        operator: usize,
        time: u64,
        reason: &str,
        placement: &mut dyn Placement,
        witness: &mut dyn Witness,
    ) -> Result<(), RunError> {
        let node = &self.graph.operators[operator];
        let state = &mut self.operators[operator];
        state.panics += 1;
        let allowed = match self.graph.processes[node.process].restart {
            Restart::Never => 0,
            Restart::OnFault { limit, .. } => limit,
        };
        if state.panics > allowed {
            return Err(RunError::Fault {
                operator: node.name.clone(),
                times: state.panics,
                reason: reason.to_string(),
            });
        }
        state.incarnation += 1;
        state.intake.renew();
        let entry = placement.start(operator, state.incarnation, time + 1)?;
        witness.saw(operator, &entry, &[]).map_err(RunError::Witness)
    }
}

impl State {
    /// Moves what has arrived by `time` into the bounded queues; the oldest goes where one is full.
    fn arrive(&mut self, time: u64) {
        for port in &mut self.ports {
            while port.under_way.front().is_some_and(|(t, _)| *t <= time) {
                if let Some((_, head)) = port.under_way.pop_front() {
                    if port.arrived.len() >= port.depth {
                        port.arrived.pop_front();
                    }
                    port.arrived.push_back(head);
                    self.dirty = true;
                }
            }
        }
    }
}

impl Waiting {
    fn of(policy: Policy) -> Self {
        Self { depth: depth_of(policy), under_way: VecDeque::new(), arrived: VecDeque::new() }
    }
}

/// How many samples wait on an input at most.
pub(crate) fn depth_of(policy: Policy) -> usize {
    match policy {
        Policy::Queue(n) => n as usize,
        // Only the newest counts; a few more, so that a delayed one is not pushed out by those behind it.
        Policy::Latest => 4,
        Policy::Sync { .. } => 8,
    }
}
