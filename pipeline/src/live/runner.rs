//! One operator in a worker: its instance, its ports, and the commit of its activations.

use stillpoint_samples::{Cause, ConsoleCommand, Entry, Outcome, Setting};
use stillpoint_shm::{Domain, Listener, Loan, Notifier, Publisher, Received, ShmError, Subscriber, Topic};

use super::contracts;
use super::error::WorkerError;
use super::journal::{PublishError, publish_entry};
use super::ports::{Depth, Outlet, Ports};
use super::stopwatch::Stopwatch;
use super::wire::{LinkReceiver, LinkSender, TransportOf};
use crate::clock::SessionClock;
use crate::drafts::{Buffer, Draft, Lender};
use crate::graph::Graph;
use crate::instance::OperatorInstance;
use crate::intake::Intake;
use crate::operator::Files;
use crate::outside::{Inbox, Message, Outside};
use crate::record::Record;
use crate::schedule::{Decision, Ticks, decide};
use crate::settings::TakenChange;

/// One operator in a worker.
pub struct OperatorRunner {
    /// Number of the operator.
    pub operator: usize,
    /// Its present incarnation.
    pub instance: OperatorInstance,
    intake: Intake<Received>,
    ports: Ports,
    /// By output.
    sending: Vec<Sending>,
    stopwatch: Option<Stopwatch>,
    inbox: Option<InboxPort>,
    link_receiver: Option<LinkReceiver>,
    every: Option<u64>,
    /// The output that answers changes of parameters, where some are live.
    settings: Option<usize>,
    /// This incarnation has no more of its own: its timer stands still.
    finished: bool,
    /// Its timer; `None` before it begins, and where it has none.
    ticks: Option<Ticks>,
    /// Time of the last activation: stamps of an operator rise.
    last: u64,
    sent_before: u64,
    /// The reason for which nothing passes over a link, until it is reported.
    pub unlinked: Option<String>,
    /// It panicked, and a new incarnation begins later.
    pub down: Option<Down>,
}

/// The incarnation that an operator begins with in a process.
#[derive(Clone, Copy, Debug)]
pub struct FirstIncarnation<'c> {
    /// Its number.
    pub number: u32,
    /// The changes of parameters that those before it took.
    pub changes: &'c [TakenChange],
}

/// How long an operator that panicked does nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Down {
    /// Until the supervisor has answered.
    Unanswered,
    /// Until this session time, ns.
    Until(u64),
}

/// What follows the publication of a sample on an output: the wake-up of consumers, and the links.
struct Sending {
    /// Wakes consumers in other processes, where there are any.
    notifier: Option<Notifier>,
    /// A sample was sent, and no consumer was woken for it yet.
    sent: bool,
    /// The links of this output.
    link_sender: Option<LinkSender>,
}

/// Commands of people, for a console.
struct InboxPort {
    commands: Subscriber,
    settings: Subscriber,
    inbox: Inbox,
    /// Keep the services alive while this process has a port on them.
    _topics: [Topic; 2],
}

/// Lends buffers in shared memory.
struct SharedMemory<'a> {
    outlets: &'a [Outlet],
    stopwatch: &'a mut Option<Stopwatch>,
    /// Why the last loan failed, where that is not used-up memory.
    fault: Option<ShmError>,
}

impl Lender for SharedMemory<'_> {
    fn loan(&mut self, port: usize, elements: usize) -> Option<Buffer> {
        match self.outlets.get(port)?.publisher.loan(elements) {
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

/// A buffer in shared memory for a sample that is sent now. One that waited on the heap gets the memory of a sample that
/// those before it pushed out, so that an activation may send more than there is room for beside what is kept. `None`:
/// consumers hold all of it.
fn into_loan(publisher: &Publisher, buffer: Buffer) -> Result<Option<Loan>, ShmError> {
    let heap = match buffer {
        Buffer::Shared(loan) => return Ok(Some(loan)),
        Buffer::Heap { .. } => buffer,
    };
    let pieces = heap.pieces();
    let elements = pieces.header().count as usize;
    let Some(mut loan) = publisher.loan(elements)? else { return Ok(None) };
    let (meta, payload) = loan.parts_mut();
    meta.copy_from_slice(pieces.meta);
    let length = payload.len().min(pieces.payload.len());
    payload[..length].copy_from_slice(&pieces.payload[..length]);
    Ok(Some(loan))
}

/// The outcome of polling a runner.
pub enum PollOutcome {
    /// An activation was done and committed.
    Activated(Outcome),
    /// Nothing to do before this time, ns; `None`: before something arrives.
    Idle(Option<u64>),
    /// A signal ended the program that does the steps. The activation is not committed: nothing in a journal could cause
    /// that again, and a replay would differ.
    Killed,
}

impl OperatorRunner {
    /// Makes the ports of an operator. `listeners` gets those that its process is woken by.
    pub fn open(
        graph: &Graph,
        operator: usize,
        first: FirstIncarnation<'_>,
        domain: &Domain,
        files: &dyn Files,
        transport_of: TransportOf,
        listeners: &mut Vec<Listener>,
    ) -> Result<Self, WorkerError> {
        let node = &graph.operators[operator];
        let inbox = Inbox::default();
        let ports = Ports::open(graph, operator, domain, Depth::OfPolicy)?;
        for inlet in ports.inlets.iter().flatten() {
            if graph.operators[inlet.edge.operator].process != node.process {
                listeners.push(inlet.topic.listener()?);
            }
        }
        let mut sending = Vec::new();
        for (port, outlet) in ports.outlets.iter().enumerate() {
            let leaves = node.outputs[port].links.iter().any(|wire| wire.is_bridged());
            let outside = leaves
                || graph.consumers(operator, port).any(|(c, _)| graph.operators[c].process != node.process);
            let notifier = if outside { Some(outlet.topic.notifier()?) } else { None };
            sending.push(Sending {
                notifier,
                sent: false,
                link_sender: LinkSender::open(node, port, transport_of)?,
            });
        }
        let stopwatch = Stopwatch::open(graph, operator, domain)?;
        let mut people = None;
        if node.stage.kind.name == crate::console::KIND_NAME {
            let commands = Topic::open(domain, &contracts::inbox(graph, operator))?;
            let settings = Topic::open(domain, &contracts::setting_inbox(graph, operator))?;
            people = Some(InboxPort {
                commands: commands.subscriber(16)?,
                settings: settings.subscriber(16)?,
                inbox: inbox.clone(),
                _topics: [commands, settings],
            });
        }
        let link_receiver = LinkReceiver::open(graph, operator, domain, transport_of)?;
        let outside = Outside { inbox, arrivals: link_receiver.as_ref().map(LinkReceiver::arrivals) };
        let instance = OperatorInstance::build(graph, operator, first.number, files, outside, first.changes)
            .map_err(|reason| WorkerError::Setup { operator: node.name.clone(), reason })?;
        Ok(Self {
            operator,
            instance,
            intake: Intake::new(node),
            ports,
            sending,
            stopwatch,
            inbox: people,
            link_receiver,
            every: node.every,
            settings: node.stage.settings_output(),
            finished: false,
            ticks: None,
            last: 0,
            sent_before: 0,
            unlinked: None,
            down: None,
        })
    }

    /// Connects to all ports that are there.
    pub fn connect(&self) -> Result<(), ShmError> {
        if let Some(stopwatch) = &self.stopwatch {
            stopwatch.connect()?;
        }
        if let Some(link_receiver) = &self.link_receiver {
            link_receiver.connect()?;
        }
        self.ports.connect()
    }

    /// Begins: marks the incarnation, and sets the timer to its next tick after `now`.
    pub fn begin(&mut self, epoch: u64, now: u64) -> Result<(), PublishError> {
        self.ticks = self.every.map(|every| Ticks::from(epoch, every, now));
        self.last = now;
        let entry = self.instance.mark(Cause::Start, now, &[]);
        self.publish_entry(&entry)
    }

    /// Replaces the incarnation after a panic, or on request; its ports, the samples that wait, and the parameters that were
    /// changed stay.
    pub fn reincarnate(
        &mut self,
        graph: &Graph,
        files: &dyn Files,
        clock: &SessionClock,
    ) -> Result<(), WorkerError> {
        let inbox = self.inbox.as_ref().map(|port| port.inbox.clone()).unwrap_or_default();
        let outside = Outside { inbox, arrivals: self.link_receiver.as_ref().map(LinkReceiver::arrivals) };
        let before = &self.instance;
        let next = before.incarnation() + 1;
        let built = OperatorInstance::build(graph, self.operator, next, files, outside, before.changes());
        self.instance = built.map_err(|reason| WorkerError::SetupOnRestart {
            operator: graph.operators[self.operator].name.clone(),
            reason,
        })?;
        self.intake.renew();
        self.down = None;
        self.finished = false;
        let now = clock.now().max(self.last + 1);
        self.last = now;
        let entry = self.instance.mark(Cause::Start, now, &[]);
        Ok(self.publish_entry(&entry)?)
    }

    /// Does one activation if there is cause for one. `timers`: whether ticks count.
    pub fn poll(&mut self, clock: &SessionClock, timers: bool) -> Result<PollOutcome, WorkerError> {
        // The clock is read once per activation.
        let now = clock.now().max(self.last + 1);
        self.read_inbox()?;
        if let Some(link_receiver) = &mut self.link_receiver
            && let Some(refusal) = link_receiver.listen()?
        {
            self.unlinked = Some(refusal.to_string());
        }
        let ticks = self.ticks.filter(|_| timers && !self.finished);
        let mut fault = None;
        let inlets = &self.ports.inlets;
        let ready =
            self.intake.ready(now, &mut |port| match inlets.get(port)?.as_ref()?.subscriber.receive() {
                Ok(sample) => sample,
                Err(e) => {
                    fault = Some(e);
                    None
                }
            });
        if let Some(fault) = fault {
            return Err(fault.into());
        }
        let Some(decision) = decide(now, ready, ticks.as_ref()) else {
            // Who has joined since gets the answers that are kept.
            if let Some(outlet) = self.settings.and_then(|port| self.ports.outlets.get(port)) {
                outlet.publisher.connect()?;
            }
            let visible = self.intake.next_visible();
            let due = ticks.map(|ticks| ticks.due());
            return Ok(PollOutcome::Idle([due, visible].into_iter().flatten().min()));
        };
        let Decision { cause, port, nominal, tick } = decision;
        if let Some(ticks) = self.ticks.as_mut().filter(|_| cause == Cause::Timer) {
            ticks.next = tick + 1;
        }
        let record = Record { time: now, nominal, tick, cause, port, inputs: self.intake.begin(cause, port) };
        self.last = now;
        let intake = &self.intake;
        if let Some(stopwatch) = &mut self.stopwatch {
            stopwatch.begin();
        }
        let mut memory =
            SharedMemory { outlets: &self.ports.outlets, stopwatch: &mut self.stopwatch, fault: None };
        let is_step = cause != Cause::Set;
        let entry = self.instance.activate(&record, &|p| Some(intake.sample(p)?.pieces()), &mut memory);
        if let Some(fault) = memory.fault {
            return Err(fault.into());
        }
        if self.instance.is_killed() {
            return Ok(PollOutcome::Killed);
        }
        let outcome = entry.outcome().unwrap_or(Outcome::Error);
        self.finished |= outcome == Outcome::Finished;
        self.commit(entry, clock, is_step)?;
        self.intake.end();
        Ok(PollOutcome::Activated(outcome))
    }

    /// Marks the end of the incarnation with the account of its inputs.
    pub fn finish(&mut self, clock: &SessionClock) -> Result<(), PublishError> {
        let now = clock.now().max(self.last + 1);
        let entry = self.instance.mark(Cause::End, now, &self.intake.account());
        self.publish_entry(&entry)
    }

    /// The commit rule: the entry, then the outputs, then the listeners. The laps of a step follow, for subscribers that poll.
    fn commit(&mut self, mut entry: Entry, clock: &SessionClock, is_step: bool) -> Result<(), WorkerError> {
        entry.body.sent_before = self.sent_before;
        self.publish_entry(&entry)?;
        let mut unsent = Vec::new();
        for Draft { port, buffer } in self.instance.take_drafts() {
            let sending = &mut self.sending[port];
            // A link needs no shared memory.
            if let Some(link_sender) = &mut sending.link_sender
                && let Some(reason) = link_sender.send(buffer.pieces())
            {
                self.unlinked = Some(reason.to_string());
            }
            let publisher = &self.ports.outlets[port].publisher;
            match into_loan(publisher, buffer)? {
                Some(loan) => {
                    publisher.send(loan)?;
                    sending.sent = true;
                }
                None => unsent.push(port),
            }
        }
        for port in unsent {
            self.instance.count_unsent(port);
        }
        for sending in &mut self.sending {
            if std::mem::take(&mut sending.sent)
                && let Some(notifier) = &sending.notifier
            {
                notifier.notify();
            }
        }
        self.sent_before = clock.now();
        if let Some(stopwatch) = self.stopwatch.as_ref().filter(|_| is_step) {
            stopwatch.send(&entry)?;
        }
        Ok(())
    }

    fn publish_entry(&self, entry: &Entry) -> Result<(), PublishError> {
        publish_entry(&self.ports.journal, entry)
    }

    fn read_inbox(&mut self) -> Result<(), ShmError> {
        if let Some(InboxPort { commands, settings, inbox, .. }) = &self.inbox {
            while let Some(sample) = commands.receive()? {
                if let Ok(view) = sample.pieces().view::<ConsoleCommand>()
                    && let Some(command) = view.first()
                {
                    inbox.put(Message::Command(*command));
                }
            }
            while let Some(sample) = settings.receive()? {
                if let Ok(view) = sample.pieces().view::<Setting>()
                    && let Some(setting) = view.first()
                {
                    inbox.put(Message::Setting(*setting));
                }
            }
        }
        Ok(())
    }
}
