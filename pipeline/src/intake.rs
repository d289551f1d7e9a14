//! The intake: how an operator's inputs become causes of activations. The same code decides live and simulated.

use stillpoint_samples::{Cause, Header, JournalRef, RefKind};

use crate::graph::OperatorNode;
use crate::operator::Policy;

/// A sample, or the name of one, on its way into an operator.
pub trait Arrival {
    /// Its header.
    fn header(&self) -> Header;
}

impl Arrival for stillpoint_shm::Received {
    fn header(&self) -> Header {
        stillpoint_shm::Received::header(self)
    }
}

impl Arrival for Header {
    fn header(&self) -> Header {
        *self
    }
}

/// What would cause an activation now.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Trigger {
    /// Since when, ns: the newest arrival that it needs.
    pub since: u64,
    /// Input or set.
    pub cause: Cause,
    /// The input, or the first of the set.
    pub port: usize,
}

/// The inputs of one operator.
pub struct Intake<T> {
    ports: Vec<Port<T>>,
    /// Whether a new `latest` sample is a cause, because no other input can be.
    latest_causes: bool,
}

struct Port<T> {
    connected: bool,
    /// It brings changes of parameters, which the operator takes between two steps.
    sets: bool,
    policy: Policy,
    leader: Option<usize>,
    delay: u64,
    /// Received, not consumed yet.
    front: Option<T>,
    /// Consumed by the activation that is under way.
    current: Option<T>,
    /// Newest of a `latest` input, and whether an activation has seen it.
    held: Option<(T, bool)>,
    count: Count,
}

/// Account of one input since it saw the producer's present incarnation.
#[derive(Clone, Copy, Default)]
struct Count {
    incarnation: Option<u32>,
    next: u64,
    total: u64,
    lost: u64,
    passed: u64,
}

impl Count {
    fn take(&mut self, header: &Header) {
        if self.incarnation == Some(header.incarnation) {
            self.lost += header.sequence.saturating_sub(self.next);
        } else {
            *self = Self { incarnation: Some(header.incarnation), ..Self::default() };
        }
        self.next = header.sequence + 1;
        self.total += 1;
    }

    fn reference(&self, port: usize, first: u64, incarnation: u32, count: u32, kind: RefKind) -> JournalRef {
        // A held sample of an incarnation that is over carries no account of the new one.
        let same = self.incarnation == Some(incarnation);
        let pick = |n: u64| if same { n } else { 0 };
        JournalRef {
            first,
            total: pick(self.total),
            lost: pick(self.lost),
            passed: pick(self.passed),
            count,
            incarnation,
            port: port as u32,
            kind: kind as u32,
        }
    }
}

impl<T: Arrival> Intake<T> {
    /// The intake of an operator.
    pub fn new(node: &OperatorNode) -> Self {
        let ports: Vec<_> = node
            .inputs
            .iter()
            .enumerate()
            .map(|(number, input)| Port {
                connected: input.edge.is_some(),
                sets: node.stage.set_input() == Some(number),
                policy: input.policy,
                leader: input.sync_leader,
                delay: input.edge.map_or(0, |e| e.delay),
                front: None,
                current: None,
                held: None,
                count: Count::default(),
            })
            .collect();
        let only_latest = ports.iter().filter(|p| p.connected && !p.sets).all(|p| p.policy == Policy::Latest);
        Self { ports, latest_causes: only_latest && node.every.is_none() }
    }

    /// Takes what has arrived by `now` as far as the policies go, and says what would cause an activation. `pull`
    /// gives the next sample that waits on an input.
    pub fn ready(&mut self, now: u64, pull: &mut dyn FnMut(usize) -> Option<T>) -> Option<Trigger> {
        let mut best: Option<Trigger> = None;
        let mut offer = |t: Trigger| {
            if best.is_none_or(|b| (t.since, t.port) < (b.since, b.port)) {
                best = Some(t);
            }
        };
        for index in 0..self.ports.len() {
            if !self.ports[index].connected {
                continue;
            }
            match self.ports[index].policy {
                Policy::Latest => {
                    let port = &mut self.ports[index];
                    while port.fill(now, index, pull) {
                        if port.held.take().is_some_and(|(_, seen)| !seen) {
                            port.count.passed += 1;
                        }
                        port.held = port.take_front().map(|t| (t, false));
                    }
                    if self.latest_causes
                        && let Some((sample, false)) = &port.held
                    {
                        offer(Trigger {
                            since: sample.header().stamp.saturating_add(port.delay),
                            cause: Cause::Input,
                            port: index,
                        });
                    }
                }
                Policy::Queue(_) => {
                    let port = &mut self.ports[index];
                    if port.fill(now, index, pull)
                        && let Some(sample) = &port.front
                    {
                        offer(Trigger {
                            since: sample.header().stamp.saturating_add(port.delay),
                            cause: if port.sets { Cause::Set } else { Cause::Input },
                            port: index,
                        });
                    }
                }
                Policy::Sync { within } => {
                    if self.ports[index].leader == Some(index)
                        && let Some(since) = self.match_set(index, within, now, pull)
                    {
                        offer(Trigger { since, cause: Cause::Sync, port: index });
                    }
                }
            }
        }
        best
    }

    /// Looks for samples in step on all inputs of the set; passes over those that have no partner any more.
    fn match_set(
        &mut self,
        leader: usize,
        within: u64,
        now: u64,
        pull: &mut dyn FnMut(usize) -> Option<T>,
    ) -> Option<u64> {
        loop {
            let (mut oldest, mut newest, mut since) = ((u64::MAX, leader), 0, 0);
            for index in 0..self.ports.len() {
                let port = &mut self.ports[index];
                if port.leader != Some(leader) {
                    continue;
                }
                if !port.fill(now, index, pull) {
                    return None;
                }
                let header = port.front.as_ref()?.header();
                oldest = oldest.min((header.origin, index));
                newest = newest.max(header.origin);
                since = since.max(header.stamp.saturating_add(port.delay));
            }
            if newest - oldest.0 <= within {
                return Some(since);
            }
            let port = &mut self.ports[oldest.1];
            port.take_front();
            port.count.passed += 1;
        }
    }

    /// When a sample that was received, but is delayed, can be seen: the earliest such time, ns.
    pub fn next_visible(&self) -> Option<u64> {
        self.ports
            .iter()
            .filter_map(|p| p.front.as_ref().map(|f| f.header().stamp.saturating_add(p.delay)))
            .min()
    }

    /// Begins the activation: what it consumes is fixed from here on. Gives one reference per sample.
    pub fn begin(&mut self, cause: Cause, port: usize) -> Vec<JournalRef> {
        let mut refs = Vec::with_capacity(self.ports.len());
        for (index, p) in self.ports.iter_mut().enumerate() {
            let consumed = match p.policy {
                // A change is not seen by a step, and consumes nothing that a step would see.
                _ if p.sets || cause == Cause::Set => cause == Cause::Set && index == port,
                Policy::Latest => {
                    if let Some((sample, seen)) = &mut p.held {
                        let header = sample.header();
                        let kind = if *seen { RefKind::Held } else { RefKind::Fresh };
                        *seen = true;
                        refs.push(p.count.reference(index, header.sequence, header.incarnation, 1, kind));
                    }
                    continue;
                }
                Policy::Queue(_) => cause == Cause::Input && index == port,
                Policy::Sync { .. } => cause == Cause::Sync && p.leader == Some(port),
            };
            if consumed && let Some(sample) = p.take_front() {
                let header = sample.header();
                refs.push(p.count.reference(index, header.sequence, header.incarnation, 1, RefKind::Fresh));
                p.current = Some(sample);
            }
        }
        refs
    }

    /// The sample that an input brings to the activation that is under way.
    pub fn sample(&self, port: usize) -> Option<&T> {
        let p = self.ports.get(port)?;
        match p.policy {
            Policy::Latest => p.held.as_ref().map(|(sample, _)| sample),
            _ => p.current.as_ref(),
        }
    }

    /// Ends the activation and gives back what it consumed.
    pub fn end(&mut self) {
        for p in &mut self.ports {
            p.current = None;
        }
    }

    /// Starts the account anew for a new incarnation of the operator; the samples that wait stay, and are counted when
    /// they are taken.
    pub fn renew(&mut self) {
        for p in &mut self.ports {
            p.current = None;
            p.count = Count { incarnation: p.count.incarnation, next: p.count.next, ..Count::default() };
        }
    }

    /// The account of every input that ever brought something, as references to no sample.
    pub fn account(&self) -> Vec<JournalRef> {
        let brought = self.ports.iter().enumerate().filter_map(|(i, p)| {
            let incarnation = p.count.incarnation?;
            Some(p.count.reference(i, p.count.next.saturating_sub(1), incarnation, 0, RefKind::Fresh))
        });
        brought.collect()
    }
}

impl<T: Arrival> Port<T> {
    /// Takes the front, and counts it: what still waits there is nobody's yet.
    fn take_front(&mut self) -> Option<T> {
        let sample = self.front.take()?;
        self.count.take(&sample.header());
        Some(sample)
    }

    /// Makes sure that the front is there; whether it can be seen at `now`.
    fn fill(&mut self, now: u64, index: usize, pull: &mut dyn FnMut(usize) -> Option<T>) -> bool {
        if self.front.is_none() {
            self.front = pull(index);
        }
        self.front.as_ref().is_some_and(|f| f.header().stamp.saturating_add(self.delay) <= now)
    }
}

#[cfg(test)]
mod tests;
