//! A process of operators: one thread, upstream before downstream.

use std::process::ExitCode;
use std::sync::Arc;

use stillpoint_samples::Outcome;
use stillpoint_shm::{Domain, Wake};

use super::affinity::place;
use super::control::{Connect, FromWorker, Hello, ToWorker};
use super::directed::DirectedWorker;
use super::error::WorkerError;
use super::log::{self, Forward};
use super::pipe::{PipeError, PipeRead, PipeReader, orders, send_message, take_control, wait_for};
use super::run_folder::hold;
use super::runner::{Down, FirstIncarnation, OperatorRunner, PollOutcome};
use super::watch::Watch;
use super::wire::{TransportOf, transport_of};
use crate::clock::{SessionClock, float_state_is_standard};
use crate::files::Snapshot;
use crate::graph::{Graph, Priority};
use crate::limits::{fail_at_the_limit_of_file_sizes, start_thread};
use crate::operator::Registry;

/// How long a worker that always finds work does not look at its control pipe, ns.
const RECEIVE_EVERY: u64 = 5_000_000;

/// The body of a worker process. Orders come on standard input; their end is the supervisor's end, and this one's.
pub fn worker_main(registry: &Registry) -> ExitCode {
    worker_main_over(registry, transport_of)
}

/// The body of a worker process whose links go over these transports. See [`worker_main`].
pub fn worker_main_over(registry: &Registry, transport_of: TransportOf) -> ExitCode {
    if take_control().is_err() {
        return ExitCode::from(70);
    }
    // Ctrl-C reaches the whole process group; the supervisor ends the run in order.
    ignore_interrupts();
    // An operator's panic is contained, journalled and told. Any other one ends the process, and is told here.
    std::panic::set_hook(Box::new(|panic| {
        if !crate::instance::is_stepping() {
            let place = panic.location().map(ToString::to_string).unwrap_or_default();
            let reason =
                format!("a fault of stillpoint itself at {place}: {}", panic.payload_as_str().unwrap_or(""));
            let _ = send_message(&FromWorker::Fault {
                operator: String::new(),
                incarnation: 0,
                reason,
                fatal: true,
            });
        }
    }));
    match serve(registry, transport_of) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            let reason = error.to_string();
            let fault = FromWorker::Fault { operator: String::new(), incarnation: 0, reason, fatal: true };
            let _ = send_message(&fault);
            ExitCode::from(70)
        }
    }
}

/// Ends this worker at once, because a step of an operator left what no operator of it may go on with. The supervisor
/// gets the reason, and starts the next incarnation as after any death.
pub fn end_worker(operator: &str, reason: &str) -> ! {
    let (operator, reason) = (operator.to_owned(), reason.to_owned());
    let _ = send_message(&FromWorker::Fault { operator, incarnation: 0, reason, fatal: true });
    std::process::exit(70)
}

/// Keeps SIGINT, SIGTERM and SIGHUP from ending this process, which ends when its pipe ends; and SIGXFSZ.
pub(super) fn ignore_interrupts() {
    fail_at_the_limit_of_file_sizes();
    // A flag that nobody reads: the signal is taken and has no effect.
    let nobody = Arc::new(std::sync::atomic::AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM, signal_hook::consts::SIGHUP] {
        let _ = signal_hook::flag::register(signal, nobody.clone());
    }
}

/// Ends this process after its supervisor and the time that it outlives it, also where a step never comes back to read
/// its orders.
pub(super) fn end_with_supervisor(outlives: u64) {
    let stdin = std::io::stdin();
    // No event is asked for: the other end's closing is always told.
    let mut fd = [rustix::event::PollFd::new(&stdin, rustix::event::PollFlags::empty())];
    while let Ok(0) | Err(rustix::io::Errno::INTR) = rustix::event::poll(&mut fd, None) {}
    // Time to end in order, for one that can.
    std::thread::sleep(std::time::Duration::from_secs(1) + std::time::Duration::from_nanos(outlives));
    std::process::exit(71);
}

/// The graph that a hello describes.
pub(super) fn graph_of(hello: &Hello, registry: &Registry) -> Result<Arc<Graph>, WorkerError> {
    let graph = hello.source.check(registry).map_err(|faults| WorkerError::Graph(Box::new(faults)))?;
    Ok(Arc::new(if hello.directed { graph } else { graph.live() }))
}

fn serve(registry: &Registry, transport_of: TransportOf) -> Result<(), WorkerError> {
    let mut orders = orders()?;
    let Some(hello) = wait_for::<Hello>(&mut orders)? else { return Ok(()) };
    if !float_state_is_standard() {
        return Err(WorkerError::FloatState);
    }
    let graph = graph_of(&hello, registry)?;
    let process = graph
        .processes
        .iter()
        .find(|p| p.name == hello.process)
        .ok_or_else(|| WorkerError::NoProcess(hello.process.clone()))?
        .clone();
    let outlives = process.outlives;
    start_thread(move || end_with_supervisor(outlives))?;
    // Lock step waits for no clock.
    let priority = if hello.directed { Priority::Normal } else { process.priority };
    let refused = place(process.core, priority)?;
    let files = hello.source.files.clone();
    let _held = hold(&hello.root)?;
    let domain = Domain::join(&hello.root, &hello.prefix, &hello.process)?;
    if hello.directed {
        return DirectedWorker::open(graph, &process, &domain, &files)?.serve(&mut orders);
    }
    let names = graph.operators.iter().map(|o| o.name.clone()).collect();
    Forward::start(&process.name, names, hello.clock);
    if let Some(refused) = refused {
        tracing::info!("{} runs with normal priority: {refused}", process.name);
    }
    let mut listeners = Vec::new();
    let mut runners = Vec::new();
    for (place, (operator, incarnation)) in process.operators.iter().zip(&hello.incarnations).enumerate() {
        log::enter(*operator);
        let changes = hello.changes.get(place).map_or(&[][..], Vec::as_slice);
        let first = FirstIncarnation { number: *incarnation, changes };
        runners.push(OperatorRunner::open(
            &graph,
            *operator,
            first,
            &domain,
            &files,
            transport_of,
            &mut listeners,
        )?);
    }
    let watch = Watch::start(&graph, &process.operators)?;
    let control = orders.fd().try_clone_to_owned().map_err(PipeError::Input)?;
    let mut worker = Worker {
        graph,
        files,
        clock: hello.clock,
        runners,
        wake: Wake::new(control, listeners),
        watch,
        outlives,
        last_at: None,
        running: false,
        stopping: false,
        stopped: false,
    };
    send_message(&FromWorker::Made)?;
    worker.serve(&mut orders)
}

struct Worker {
    graph: Arc<Graph>,
    files: Snapshot,
    clock: SessionClock,
    runners: Vec<OperatorRunner>,
    wake: Wake,
    watch: Option<Watch>,
    /// How long it goes on after its supervisor died, ns.
    outlives: u64,
    /// When it ends, its supervisor being dead.
    last_at: Option<u64>,
    running: bool,
    stopping: bool,
    stopped: bool,
}

impl Worker {
    fn serve(&mut self, orders: &mut PipeReader) -> Result<(), WorkerError> {
        let mut received = 0;
        let mut reported = true;
        loop {
            // A look at the pipe is a call into the system: on the data path it is taken only now and then.
            if self.last_at.is_some_and(|at| self.clock.now() >= at) {
                return Ok(self.runners.iter_mut().try_for_each(|runner| runner.finish(&self.clock))?);
            }
            if self.last_at.is_none() && (reported || self.clock.now() >= received + RECEIVE_EVERY) {
                loop {
                    match orders.next()? {
                        PipeRead::Message(ToWorker::Exit) => return Ok(()),
                        PipeRead::Ended if self.outlives == 0 || !self.running || self.stopped => {
                            return Ok(());
                        }
                        PipeRead::Ended => {
                            // Nobody gives orders any more; what is driven from here is brought to its end.
                            self.last_at = Some(self.clock.now().saturating_add(self.outlives));
                            self.wake.forget_control();
                            break;
                        }
                        PipeRead::Message(order) => self.obey(&order)?,
                        PipeRead::Nothing => break,
                    }
                }
                received = self.clock.now();
                reported = false;
            }
            let active = self.running && !self.stopped;
            let mut next = None;
            if active {
                let (worked, at) = self.pass()?;
                if worked {
                    continue;
                }
                next = at;
            }
            // Wake-ups are taken when the work is done: the work would have to wait for it.
            if self.wake.drain()? {
                continue;
            }
            if active && self.stopping {
                for runner in &mut self.runners {
                    runner.finish(&self.clock)?;
                }
                self.stopped = true;
                send_message(&FromWorker::Stopped)?;
                continue;
            }
            let next = [next, self.last_at].into_iter().flatten().min();
            let timeout = next.map(|at| at.saturating_sub(self.clock.now()));
            reported = self.wake.wait(timeout)?;
        }
    }

    fn obey(&mut self, order: &ToWorker) -> Result<(), WorkerError> {
        match order {
            ToWorker::Connect(Connect { number }) => {
                for runner in &self.runners {
                    runner.connect()?;
                }
                Ok(send_message(&FromWorker::Connected { number: *number })?)
            }
            ToWorker::Go { epoch } => {
                let now = self.clock.now().max(*epoch);
                for runner in &mut self.runners {
                    runner.begin(*epoch, now)?;
                }
                self.running = true;
                Ok(())
            }
            ToWorker::Stop => {
                self.stopping = true;
                Ok(())
            }
            ToWorker::Renew { operator, at } => {
                for runner in self.runners.iter_mut().filter(|m| m.operator == *operator && m.down.is_some())
                {
                    runner.down = Some(Down::Until(*at));
                }
                Ok(())
            }
            ToWorker::Restart { operator } => {
                let ours = self.runners.iter_mut().filter(|r| r.operator == *operator && r.down.is_none());
                for runner in ours.filter(|_| self.running && !self.stopping) {
                    runner.reincarnate(&self.graph, &self.files, &self.clock)?;
                }
                Ok(())
            }
            other => Err(WorkerError::NotDirected(format!("{other:?}"))),
        }
    }

    /// Polls every runner once, upstream first. Gives whether an activation was done, and when the next poll is due.
    fn pass(&mut self) -> Result<(bool, Option<u64>), WorkerError> {
        let mut worked = false;
        let mut next: Option<u64> = None;
        for runner in &mut self.runners {
            match runner.down {
                None => {}
                Some(Down::Until(at)) if at <= self.clock.now() && !self.stopping => {
                    runner.reincarnate(&self.graph, &self.files, &self.clock)?;
                }
                Some(Down::Until(at)) => {
                    next = [next, Some(at)].into_iter().flatten().min();
                    continue;
                }
                Some(Down::Unanswered) => continue,
            }
            log::enter(runner.operator);
            if let Some(watch) = &self.watch {
                watch.enter(runner.operator);
            }
            let looked = runner.poll(&self.clock, !self.stopping);
            if let Some(watch) = &self.watch {
                watch.leave();
            }
            match looked? {
                PollOutcome::Activated(outcome) => {
                    worked = true;
                    let reported = report(runner, outcome, &self.graph);
                    // Once the supervisor is dead nobody hears it.
                    if self.last_at.is_none() {
                        reported?;
                    }
                }
                // As if the signal had been for this process: so the ledger and a replay know what to make of it.
                PollOutcome::Killed => {
                    let reason = runner.instance.fault().unwrap_or_default();
                    end_worker(&self.graph.operators[runner.operator].name, reason)
                }
                PollOutcome::Idle(at) => next = [next, at].into_iter().flatten().min(),
            }
        }
        Ok((worked, next))
    }
}

/// Reports an activation that failed. After a panic, the operator does nothing until the supervisor has answered.
fn report(runner: &mut OperatorRunner, outcome: Outcome, graph: &Graph) -> Result<(), PipeError> {
    let operator = || graph.operators[runner.operator].name.clone();
    let incarnation = runner.instance.incarnation();
    if let Some(reason) = runner.unlinked.take() {
        send_message(&FromWorker::Fault { operator: operator(), incarnation, reason, fatal: false })?;
    }
    if !outcome.is_failure() {
        return Ok(());
    }
    let operator = operator();
    let reason = runner.instance.fault().unwrap_or_default().to_string();
    if outcome == Outcome::Panic {
        runner.down = Some(Down::Unanswered);
        return send_message(&FromWorker::Panicked { operator, incarnation, reason });
    }
    send_message(&FromWorker::Fault { operator, incarnation, reason, fatal: false })
}
