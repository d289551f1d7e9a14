//! One operator in a worker: its instance, its ports, and the commit of its activations.

use stillpoint_samples::{Cause, ConsoleCommand, Entry, Outcome};
use stillpoint_shm::{Domain, Listener, Notifier, Publisher, Received, ShmError, Subscriber, Topic};

use super::contracts;
use super::journal::publish_entry;
use super::stopwatch::Stopwatch;
use super::wire::{LinkReceiver, LinkSender};
use crate::clock::SessionClock;
use crate::drafts::{Buffer, Lender};
use crate::graph::Graph;
use crate::instance::OperatorInstance;
use crate::intake::Intake;
use crate::operator::Files;
use crate::outside::{Inbox, Outside};
use crate::record::Record;
use crate::schedule::depth_of;

/// One operator in a worker.
pub struct OperatorRunner {
    /// Number of the operator.
    pub operator: usize,
    /// Its present incarnation.
    pub instance: OperatorInstance,
    intake: Intake<Received>,
    inlets: Vec<Option<Subscriber>>,
    outlets: Outlets,
    journal: Publisher,
    inbox: Option<(Subscriber, Inbox)>,
    link_receiver: Option<LinkReceiver>,
    every: Option<u64>,
    /// This incarnation has no more of its own: its timer stands still.
    finished: bool,
    tick: u64,
    epoch: u64,
    /// Time of the last activation: stamps of an operator rise.
    last: u64,
    sent_before: u64,
    /// Why nothing goes over a link, or comes, until it is told.
    pub unlinked: Option<String>,
    /// It panicked, and a new incarnation begins later.
    pub down: Option<Down>,
    /// Keeps the services alive while this process has ports on them.
    _topics: Vec<Topic>,
}

/// Until when an operator that panicked does nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Down {
    /// Until the supervisor has answered.
    Unanswered,
    /// Until this session time, ns.
    Until(u64),
}

struct Outlet {
    publisher: Publisher,
    /// Wakes consumers in other processes, where there are any.
    notifier: Option<Notifier>,
    /// Something was sent that nobody was woken for yet.
    sent: bool,
    /// The links of this output.
    link_sender: Option<LinkSender>,
}

struct Outlets {
    ports: Vec<Outlet>,
    stopwatch: Option<Stopwatch>,
    /// What the last loan failed of, other than used-up memory.
    fault: Option<ShmError>,
}

impl Lender for Outlets {
    fn loan(&mut self, port: usize, elements: usize) -> Option<Buffer> {
        match self.ports.get(port)?.publisher.loan(elements) {
            Ok(loan) => loan.map(Buffer::Shared),
            Err(e) => {
                self.fault = Some(e);
                None
            }
        }
    }

    fn lap(&mut self, lap: usize) {
        if let Some(stopwatch) = &mut self.stopwatch {
            stopwatch.lap(lap);
        }
    }
}

/// What a look at a runner came to.
pub enum PollOutcome {
    /// An activation was done and committed.
    Activated(Outcome),
    /// Nothing to do before this time, ns; `None`: before something arrives.
    Idle(Option<u64>),
}

impl OperatorRunner {
    /// Makes the ports of an operator. `listeners` gets those that its process is woken by.
    pub fn open(
        graph: &Graph,
        operator: usize,
        incarnation: u32,
        domain: &Domain,
        files: &dyn Files,
        listeners: &mut Vec<Listener>,
    ) -> Result<Self, String> {
        let node = &graph.operators[operator];
        let text = |e: ShmError| e.to_string();
        let inbox = Inbox::default();
        let mut topics = Vec::new();
        let mut inlets = Vec::new();
        for input in &node.inputs {
            let Some(edge) = input.edge else {
                inlets.push(None);
                continue;
            };
            let topic =
                Topic::open(domain, &contracts::output(graph, edge.operator, edge.output)).map_err(text)?;
            inlets.push(Some(topic.subscriber(depth_of(input.policy)).map_err(text)?));
            if graph.operators[edge.operator].process != node.process {
                listeners.push(topic.listener().map_err(text)?);
            }
            topics.push(topic);
        }
        let mut ports = Vec::new();
        for port in 0..node.outputs.len() {
            let topic = Topic::open(domain, &contracts::output(graph, operator, port)).map_err(text)?;
            let outside =
                graph.consumers(operator, port).any(|(c, _)| graph.operators[c].process != node.process);
            let notifier = if outside { Some(topic.notifier().map_err(text)?) } else { None };
            let link_sender = LinkSender::open(node, port)?;
            ports.push(Outlet {
                publisher: topic.publisher().map_err(text)?,
                notifier,
                sent: false,
                link_sender,
            });
            topics.push(topic);
        }
        let stopwatch = Stopwatch::open(graph, operator, domain).map_err(text)?;
        let journal = Topic::open(domain, &contracts::journal(graph, operator)).map_err(text)?;
        let journal_port = journal.publisher().map_err(text)?;
        topics.push(journal);
        let mut people = None;
        if node.stage.kind.name == crate::console::KIND_NAME {
            let topic = Topic::open(domain, &contracts::inbox(graph, operator)).map_err(text)?;
            people = Some((topic.subscriber(16).map_err(text)?, inbox.clone()));
            topics.push(topic);
        }
        let link_receiver = LinkReceiver::open(node)?;
        let outside = Outside { inbox, arrivals: link_receiver.as_ref().map(LinkReceiver::arrivals) };
        let instance = OperatorInstance::build(graph, operator, incarnation, files, outside)
            .map_err(|e| format!("{}: {}", node.name, e.0))?;
        Ok(Self {
            operator,
            instance,
            intake: Intake::new(node),
            inlets,
            outlets: Outlets { ports, stopwatch, fault: None },
            journal: journal_port,
            inbox: people,
            link_receiver,
            every: node.every,
            finished: false,
            tick: 0,
            epoch: 0,
            last: 0,
            sent_before: 0,
            unlinked: None,
            down: None,
            _topics: topics,
        })
    }

    /// Connects to all ports that are there.
    pub fn connect(&self) -> Result<(), ShmError> {
        for outlet in &self.outlets.ports {
            outlet.publisher.connect()?;
        }
        if let Some(stopwatch) = &self.outlets.stopwatch {
            stopwatch.connect()?;
        }
        self.journal.connect()?;
        for inlet in self.inlets.iter().flatten() {
            inlet.connect()?;
        }
        Ok(())
    }

    /// Begins: marks the incarnation, and sets the timer to its next tick after `now`.
    pub fn begin(&mut self, epoch: u64, now: u64) -> Result<(), String> {
        self.epoch = epoch;
        if let Some(every) = self.every {
            self.tick = now.saturating_sub(epoch).div_ceil(every);
        }
        self.last = now;
        let entry = self.instance.mark(Cause::Start, now, &[]);
        self.publish_entry(&entry)
    }

    /// Replaces the incarnation after a panic; its ports and the samples that wait stay.
    pub fn reincarnate(
        &mut self,
        graph: &Graph,
        files: &dyn Files,
        clock: &SessionClock,
    ) -> Result<(), String> {
        let inbox = self.inbox.as_ref().map(|(_, inbox)| inbox.clone()).unwrap_or_default();
        let outside = Outside { inbox, arrivals: self.link_receiver.as_ref().map(LinkReceiver::arrivals) };
        self.instance =
            OperatorInstance::build(graph, self.operator, self.instance.incarnation() + 1, files, outside)
                .map_err(|e| {
                    format!("{} cannot be made again: {}", graph.operators[self.operator].name, e.0)
                })?;
        self.intake.renew();
        self.down = None;
        self.finished = false;
        let now = clock.now().max(self.last + 1);
        self.last = now;
        let entry = self.instance.mark(Cause::Start, now, &[]);
        self.publish_entry(&entry)
    }

    /// Does one activation if there is cause for one. `timers`: whether ticks count.
    pub fn look(&mut self, clock: &SessionClock, timers: bool) -> Result<PollOutcome, String> {
        // The clock is read once per activation.
        let now = clock.now().max(self.last + 1);
        self.read_inbox()?;
        if let Some(link_receiver) = &self.link_receiver
            && let Some(reason) = link_receiver.listen()?
        {
            self.unlinked = Some(reason);
        }
        let due = self
            .every
            .filter(|_| timers && !self.finished)
            .map(|every| self.epoch.saturating_add(self.tick.saturating_mul(every)));
        let mut fault = None;
        let inlets = &self.inlets;
        let ready = self.intake.ready(now, &mut |port| match inlets.get(port)?.as_ref()?.receive() {
            Ok(sample) => sample,
            Err(e) => {
                fault = Some(e);
                None
            }
        });
        if let Some(fault) = fault {
            return Err(fault.to_string());
        }
        let due_now = due.filter(|d| *d <= now);
        let input = ready.filter(|trigger| due_now.is_none_or(|d| trigger.since <= d));
        let (cause, port, nominal, tick) = match (input, due_now, self.every) {
            (Some(trigger), _, _) => (trigger.cause, trigger.port, now, 0),
            (None, Some(_), Some(every)) => {
                // Ticks that passed while the operator was busy are skipped; the number of the tick shows it.
                let tick = (now - self.epoch) / every;
                self.tick = tick + 1;
                (Cause::Timer, 0, self.epoch.saturating_add(tick.saturating_mul(every)), tick)
            }
            _ => {
                let visible = self.intake.next_visible();
                return Ok(PollOutcome::Idle([due, visible].into_iter().flatten().min()));
            }
        };
        let record = Record { time: now, nominal, tick, cause, port, inputs: self.intake.begin(cause, port) };
        self.last = now;
        let intake = &self.intake;
        if let Some(stopwatch) = &mut self.outlets.stopwatch {
            stopwatch.begin();
        }
        let entry = self.instance.activate(&record, &|p| Some(intake.sample(p)?.pieces()), &mut self.outlets);
        let outcome = entry.outcome().unwrap_or(Outcome::Error);
        self.finished |= outcome == Outcome::Finished;
        self.commit(entry, clock)?;
        self.intake.end();
        Ok(PollOutcome::Activated(outcome))
    }

    /// Marks the end of the incarnation with the account of its inputs.
    pub fn finish(&mut self, clock: &SessionClock) -> Result<(), String> {
        let now = clock.now().max(self.last + 1);
        let entry = self.instance.mark(Cause::End, now, &self.intake.account());
        self.publish_entry(&entry)
    }

    /// The commit rule: the entry, then the outputs, then the listeners. What was measured follows, for those who poll.
    fn commit(&mut self, mut entry: Entry, clock: &SessionClock) -> Result<(), String> {
        if let Some(fault) = self.outlets.fault.take() {
            return Err(fault.to_string());
        }
        entry.body.sent_before = self.sent_before;
        self.publish_entry(&entry)?;
        for draft in self.instance.take_drafts() {
            if let Buffer::Shared(loan) = draft.buffer {
                let outlet = &mut self.outlets.ports[draft.port];
                if let Some(link_sender) = &mut outlet.link_sender
                    && let Some(reason) = link_sender.send(loan.pieces())
                {
                    self.unlinked = Some(reason);
                }
                outlet.publisher.send(loan).map_err(|e| e.to_string())?;
                outlet.sent = true;
            }
        }
        for outlet in &mut self.outlets.ports {
            if std::mem::take(&mut outlet.sent)
                && let Some(notifier) = &outlet.notifier
            {
                notifier.notify();
            }
        }
        self.sent_before = clock.now();
        if let Some(stopwatch) = &self.outlets.stopwatch {
            stopwatch.send(&entry).map_err(|e| e.to_string())?;
        }
        Ok(())
    }

    fn publish_entry(&self, entry: &Entry) -> Result<(), String> {
        publish_entry(&self.journal, entry)
    }

    fn read_inbox(&mut self) -> Result<(), String> {
        if let Some((subscriber, inbox)) = &self.inbox {
            while let Some(sample) = subscriber.receive().map_err(|e| e.to_string())? {
                if let Ok(view) = sample.pieces().view::<ConsoleCommand>()
                    && let Some(command) = view.first()
                {
                    inbox.put(*command);
                }
            }
        }
        Ok(())
    }
}
