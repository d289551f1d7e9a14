//! The client of the planning pool in an operator: messages come as samples, and the time is that of activations.

use std::collections::{BTreeSet, VecDeque};

use stillpoint_operator::{Outputs, StepError};
use stillpoint_pool::{Build, Client, ClientSettings, Event, Hash, Message, To, topic};
use stillpoint_samples::{Diagnostics, Metric, PoolMessage, PoolWord, View};

use crate::job::Job;
use crate::params::PoolParams;
use crate::patient::Patient;
use crate::remote::Served;

/// Messages of one activation; the others follow with the next.
const MOST_SENT: usize = 16;
/// Time between two activations after which messages may wait that tell of the time between, ns.
const LONG_STEP: u64 = 500_000_000;
/// Bytes of answers that are kept for work that begins anew.
const MOST_RETAINED: usize = 64 << 20;
/// Metrics of a sample of diagnostics.
pub const METRICS: usize = 9;

/// The pool of an operator.
pub struct Pooled {
    client: Client,
    /// This run has no network.
    alone: bool,
    /// Calls that this operator is to compute.
    compute: VecDeque<Hash>,
    out: VecDeque<(To, Message)>,
    last: u64,
    /// A long step lies behind: what came in meanwhile waits, and workers that are silent may have spoken.
    busy: bool,
    reported: Vec<Metric>,
}

/// How the work goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PoolState {
    /// By the answers of workers.
    Pool,
    /// By this operator, as without a pool.
    Alone,
    /// In the degraded mode: no worker has been there for the time of patience.
    Degraded,
}

/// What time and messages brought.
pub struct Turn {
    /// How the work goes on.
    pub state: PoolState,
    /// Answers of workers that were shut out: what was made of them is in doubt.
    pub tainted: BTreeSet<Hash>,
}

impl Pooled {
    /// From this time on.
    pub fn new(now: u64, build: Build, params: &PoolParams) -> Self {
        let settings = ClientSettings {
            patience: params.patience,
            checked: params.checked,
            most_retained: MOST_RETAINED,
            ..ClientSettings::new(build)
        };
        Self {
            client: Client::new(now, settings),
            alone: false,
            compute: VecDeque::new(),
            out: VecDeque::new(),
            last: now,
            busy: false,
            reported: Vec::new(),
        }
    }

    /// Forgets the calls of the work that ends.
    pub fn leave(&mut self) {
        self.client.cancel_all();
        self.compute.clear();
    }

    /// Takes a message.
    pub fn handle(&mut self, now: u64, message: &View<'_, PoolMessage>, served: &Served<'_>) {
        if message.body.word == PoolWord::NoNetwork as u32 {
            self.alone = true;
        } else if let Some((from, bytes)) = topic::split(message.elements) {
            self.alone = false;
            self.client.handle(now, from, bytes, served);
        }
    }

    /// Lets time pass, and brings the job on as far as its answers go. `is_tick`: by the timer, which comes after all messages
    /// that wait, so that it may take time to compute a call.
    pub fn go_on(
        &mut self,
        now: u64,
        is_tick: bool,
        patient: &Patient,
        mut job: Option<&mut Job>,
    ) -> Result<Turn, StepError> {
        self.busy = !is_tick && (self.busy || now.saturating_sub(self.last) > LONG_STEP);
        self.last = now;
        let mut may_compute = is_tick;
        let build = self.client.build().clone();
        loop {
            if !self.busy {
                self.client.tick(now);
            }
            // Which worker is there, and why one is not asked.
            self.client.take_news().iter().for_each(|news| tracing::info!("{news}"));
            let tainted = self.client.take_tainted();
            if self.alone || !tainted.is_empty() {
                return Ok(Turn { state: self.state(now), tainted });
            }
            let Some(job) = job.as_deref_mut().filter(|job| !job.ended) else { break };
            if self.client.is_without_workers(now) {
                break;
            }
            match self.client.next_event() {
                Some(Event::Answer(key, answer)) => job.answer(&key, &answer)?,
                Some(Event::Compute(key)) => self.compute.push_back(key),
                None => {
                    if may_compute && let Some(key) = self.compute.pop_front() {
                        may_compute = false;
                        if let Some(answer) = job.compute(patient, &key)? {
                            self.client.settle(&key, answer);
                        }
                        continue;
                    }
                    let calls = job.calls(patient, &build)?;
                    if calls.is_empty() {
                        break;
                    }
                    for call in &calls {
                        self.client.submit(now, call);
                    }
                }
            }
        }
        Ok(Turn { state: self.state(now), tainted: BTreeSet::new() })
    }

    fn state(&self, now: u64) -> PoolState {
        match (self.alone, self.client.is_without_workers(now)) {
            (true, _) => PoolState::Alone,
            (false, true) => PoolState::Degraded,
            (false, false) => PoolState::Pool,
        }
    }

    /// Sends what waits to be sent.
    pub fn send(&mut self, port: usize, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        self.out.extend(self.client.take_messages());
        let count = self.out.len().min(MOST_SENT);
        for (to, message) in self.out.drain(..count) {
            let (body, bytes) = topic::sample(&to, &message);
            // What does not fit is as good as lost: the call is computed here after the time of patience.
            if bytes.len() <= outputs.capacity(port) {
                outputs.send_slice::<PoolMessage>(port, &body, &bytes)?;
            }
        }
        Ok(())
    }

    /// Tells how the pool does, when that is new.
    pub fn report(&mut self, now: u64, port: usize, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let tally = self.client.tally();
        let build = self.client.build().text();
        let workers = self.client.workers().values();
        let (same, other): (Vec<_>, Vec<_>) = workers.partition(|worker| worker.hello.build == build);
        let shut_out = same.iter().filter(|worker| worker.shut_out.is_some()).count();
        let metrics = vec![
            Metric::new("workers", self.client.usable(now) as f64),
            Metric::new("workers_of_other_builds", other.len() as f64),
            Metric::new("workers_shut_out", shut_out as f64),
            Metric::new("calls_by_workers", tally.remote as f64),
            Metric::new("calls_here", tally.local as f64),
            Metric::new("answers_compared", tally.compared as f64),
            Metric::new("calls_asked_twice", tally.hedged as f64),
            Metric::new("no_network", f64::from(u8::from(self.alone))),
            Metric::new("degraded", f64::from(u8::from(self.state(now) == PoolState::Degraded))),
        ];
        if metrics != self.reported {
            outputs.send_slice::<Diagnostics>(port, &(), &metrics)?;
            self.reported = metrics;
        }
        Ok(())
    }
}
